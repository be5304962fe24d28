//! Draws the path of stock removal for a few contours as SVG files: `draw_stock FOLDER`.
//!
//! Invariant: the picture shows the moves as emitted, without smoothing: grey the contour, dashed red rapids, blue
//! roughing, orange plunging, green finishing.

use std::fmt::Write as _;
use std::path::Path as Folder;

use retrace_cycles::stock::{
    Corner, Element, Feed, Kind, LIFT_OFF, MoveKind, Path, Point, StockRemovalParams, ToolTip, plan,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: draw_stock FOLDER")?;
    for (name, job) in jobs() {
        let path = plan(&job)?;
        std::fs::write(Folder::new(&folder).join(format!("{name}.svg")), svg(&job, &path))?;
        println!("{name}: {} moves, warnings {:?}", path.moves.len(), path.warnings);
    }
    Ok(())
}

/// Name, VARI, infeed, nose radius, points (Z, X as a radius) with the corner at each.
type Drawing<'a> = (&'a str, i32, f64, f64, &'a [(f64, f64, Corner)]);

fn jobs() -> Vec<(String, StockRemovalParams)> {
    const NONE: Corner = Corner::None;
    const ROUND: Corner = Corner::Rounding(2.0);
    const OUTSIDE: &[(f64, f64, Corner)] = &[
        (0.0, 10.0, NONE),
        (-12.0, 10.0, ROUND),
        (-18.0, 16.0, NONE),
        (-24.0, 16.0, NONE),
        (-30.0, 11.0, NONE),
        (-38.0, 11.0, ROUND),
        (-38.0, 22.0, Corner::ChamferLeg(2.0)),
        (-50.0, 22.0, NONE),
    ];
    const HUMPS: &[(f64, f64, Corner)] = &[
        (0.0, 20.0, NONE),
        (-5.0, 20.0, NONE),
        (-12.0, 8.0, ROUND),
        (-18.0, 15.0, ROUND),
        (-24.0, 6.0, ROUND),
        (-28.0, 17.0, NONE),
        (-31.0, 17.0, NONE),
        (-36.0, 10.0, NONE),
        (-40.0, 10.0, NONE),
        (-46.0, 24.0, NONE),
    ];
    const FACE: &[(f64, f64, Corner)] = &[
        (-20.0, 40.0, NONE),
        (-20.0, 30.0, ROUND),
        (-8.0, 24.0, NONE),
        (-12.0, 18.0, NONE),
        (-12.0, 14.0, NONE),
        (0.0, 8.0, NONE),
    ];
    const INSIDE: &[(f64, f64, Corner)] = &[
        (0.0, 30.0, NONE),
        (-15.0, 30.0, ROUND),
        (-15.0, 22.0, NONE),
        (-22.0, 26.0, NONE),
        (-30.0, 26.0, NONE),
        (-34.0, 14.0, NONE),
    ];
    let drawings: [Drawing<'_>; 6] = [
        ("outside", 9, 2.5, 0.0, OUTSIDE),
        ("outside-nose", 1, 2.5, 1.2, OUTSIDE),
        ("humps", 1, 2.0, 0.0, HUMPS),
        ("humps-nose", 1, 2.0, 0.8, HUMPS),
        ("face", 10, 2.0, 0.0, FACE),
        ("inside", 11, 2.0, 0.0, INSIDE),
    ];
    drawings.map(|(name, vari, mid, nose, points)| (name.to_owned(), job(vari, mid, nose, points))).into()
}

fn job(vari: i32, mid: f64, nose_radius: f64, points: &[(f64, f64, Corner)]) -> StockRemovalParams {
    let element = |pair: &[(f64, f64, Corner)]| {
        let (start, end) = (Point::new(pair[0].0, pair[0].1), Point::new(pair[1].0, pair[1].1));
        Element { kind: Kind::Line, start, end, centre: start, corner: pair[1].2, line: 0 }
    };
    StockRemovalParams {
        contour: points.windows(2).map(element).collect(),
        vari,
        mid,
        fal_z: 0.3,
        fal_x: 0.5,
        fal: 0.0,
        dam: 0.0,
        vrt: LIFT_OFF,
        nose_radius,
        tip: ToolTip::of_orientation(2),
        clearance_angle: 0.0,
        rough_compensated: true,
        position: None,
    }
}

/// Z to the right, X upwards, one millimetre to ten units.
fn svg(job: &StockRemovalParams, path: &Path) -> String {
    let mut ends: Vec<Point> = path.moves.iter().map(|step| step.end).collect();
    ends.extend(job.contour.iter().map(|element| element.start));
    let low = ends.iter().fold((f64::MAX, f64::MAX), |low, end| (low.0.min(end.u), low.1.min(end.v)));
    let high = ends.iter().fold((f64::MIN, f64::MIN), |high, end| (high.0.max(end.u), high.1.max(end.v)));
    let place = |point: Point| format!("{:.2} {:.2}", 20.0 * (point.u - low.0 + 1.0), 20.0 * (high.1 - point.v + 1.0));
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0}\" height=\"{1:.0}\" viewBox=\"0 0 {0:.0} {1:.0}\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        20.0 * (high.0 - low.0 + 2.0),
        20.0 * (high.1 - low.1 + 2.0)
    );
    let contour: Vec<String> =
        job.contour.iter().flat_map(|element| [place(element.start), place(element.end)]).collect();
    let _ = writeln!(text, "<path d=\"M{}\" fill=\"none\" stroke=\"#bbb\" stroke-width=\"4\"/>", contour.join(" L"));
    let mut at = path.start;
    for step in &path.moves {
        let (colour, dash) = match step.feed {
            Feed::Rapid => ("red", " stroke-dasharray=\"4 3\""),
            Feed::Rough => ("blue", ""),
            Feed::Plunge => ("orange", ""),
            Feed::Finish => ("green", ""),
        };
        let radius = 20.0 * (at.u - step.centre.u).hypot(at.v - step.centre.v);
        let way = match step.kind {
            MoveKind::Rapid | MoveKind::Line => "L".to_owned(),
            MoveKind::Clockwise => format!("A{radius:.2} {radius:.2} 0 0 1 "),
            MoveKind::Counterclockwise => format!("A{radius:.2} {radius:.2} 0 0 0 "),
        };
        let _ = writeln!(
            text,
            "<path d=\"M{} {way}{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"{dash}/>",
            place(at),
            place(step.end)
        );
        at = step.end;
    }
    text + "</svg>\n"
}
