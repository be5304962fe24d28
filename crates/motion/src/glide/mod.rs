//! Glides: sharp corners passed by letting the motion on one track die away while that on the next one begins (SMO-1 … SMO-7).
//!
//! Invariant: see the rooms; a glide is legal and never slower than a stop in the corner.

pub(crate) mod book;
pub(crate) mod optimum;
pub(crate) mod passage;
pub(crate) mod ramp;
pub(crate) mod simplex;
pub(crate) mod tracks;

#[cfg(test)]
mod trial {
    use super::optimum::*;
    use super::tracks::*;
    use crate::limits::Limits;
    #[test]
    fn table() {
        let axes = Limits::<2>::built_in().planned();
        let mut all = vec![];
        let text = std::fs::read_to_string("/tmp/corner_optima.csv").unwrap();
        for line in text.lines().skip(1) {
            let f: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
            let (deg, leg, tol, opt, stop) = (f[0], f[1], f[2], f[3], f[4]);
            let (s, c) = deg.to_radians().sin_cos();
            let pair = [[1.0, 0.0], [c, s]].map(|u| Track::new(u, leg, FarEnd::Rest, 1e9, &axes));
            let tracks = Tracks { pair, tolerance: tol };
            let mut o = Optimiser::default();
            let mut row = vec![];
            let t0 = std::time::Instant::now();
            let n = 13;
            let mut last: Option<Found> = None;
            for k in 0..n {
                let d = 0.024 * (0.2f64 / 0.024).powf(k as f64 / (n - 1) as f64);
                let f = o.find(&tracks, &axes, d, last.as_ref().map(|f| &f.ramps));
                last = f.or(last);
                row.push(f.map_or(9.0, |f| f.time / opt));
            }
            let el = t0.elapsed().as_secs_f64() / n as f64 * 1e6;
            let best = row.iter().copied().fold(9.0, f64::min);
            all.push(best);
            println!("{deg:4} {leg:3} {tol:6} stop {:.3} best {best:.3} | {:.3?} {el:.0} us", stop / opt, row);
        }
        all.sort_by(f64::total_cmp);
        println!("median {:.4} worst {:.4}", all[all.len() / 2], all[all.len() - 1]);
    }
}
