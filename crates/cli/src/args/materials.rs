//! Arguments of `retrace materials`.

use std::path::PathBuf;

use clap::{Subcommand, ValueEnum};

/// `retrace materials`
#[derive(Debug, Subcommand)]
pub enum Materials {
    /// Read a material file of QtPlasmaC and write a material table.
    #[command(after_help = "Example:\n  retrace materials import plasma_material.cfg --units mm --out materials.toml")]
    Import {
        /// The material file, `…_material.cfg`.
        file: PathBuf,
        /// Unit of its lengths; a material file does not say it. With inches, gas pressures are in psi.
        #[arg(long, value_enum)]
        units: Units,
        /// File to write, standard output by default. An existing file is not overwritten.
        #[arg(short, long, value_name = "FILE.toml", visible_alias = "output")]
        out: Option<PathBuf>,
    },
    /// Write a material table as a material file of QtPlasmaC.
    #[command(after_help = "Example:\n  retrace materials export materials.toml --out plasma_material.cfg")]
    Export {
        /// The material table.
        table: PathBuf,
        /// Unit of the lengths that are written; by default that of the table.
        #[arg(long, value_enum)]
        units: Option<Units>,
        /// File to write, standard output by default. An existing file is not overwritten.
        #[arg(short, long, value_name = "FILE.cfg", visible_alias = "output")]
        out: Option<PathBuf>,
    },
    /// List the materials of a table: number, name, feed rate, pierce and cut height.
    #[command(after_help = "Example:\n  retrace materials list materials.toml")]
    List {
        /// The material table.
        table: PathBuf,
    },
    /// Print every figure of a material.
    #[command(after_help = "Example:\n  retrace materials show materials.toml 3")]
    Show {
        /// The material table.
        table: PathBuf,
        /// Number of the material.
        number: u32,
    },
}

/// Units of lengths.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Units {
    /// Millimetres.
    Mm,
    /// Inches.
    Inch,
}
