//! Canvas of dots in cells: two across and four down in each, which are about equally spaced in a terminal.
//!
//! Invariant: nothing is drawn outside its area, wherever the points lie.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;

/// Cell of dots.
#[derive(Clone, Copy, Debug, Default)]
struct Dots {
    bits: u8,
    style: Style,
    /// Sign that replaces the dots.
    sign: Option<char>,
}

/// Area of dots.
#[derive(Clone, Debug)]
pub(super) struct Canvas {
    area: Rect,
    cells: Vec<Dots>,
}

impl Canvas {
    /// Canvas over an area.
    pub(super) fn over(area: Rect) -> Self {
        Self { area, cells: vec![Dots::default(); usize::from(area.width) * usize::from(area.height)] }
    }

    /// Size in dots.
    pub(super) fn size(&self) -> [f64; 2] {
        [f64::from(self.area.width) * 2.0, f64::from(self.area.height) * 4.0]
    }

    fn cell(&mut self, x: f64, y: f64) -> Option<&mut Dots> {
        let [width, height] = self.size();
        if !(0.0..width).contains(&x) || !(0.0..height).contains(&y) {
            return None;
        }
        let index = (y as usize / 4) * usize::from(self.area.width) + x as usize / 2;
        self.cells.get_mut(index)
    }

    /// Draws a line with one dot in `every`, or with a sign in each of its cells.
    pub(super) fn line(&mut self, from: [f64; 2], to: [f64; 2], every: usize, sign: Option<char>, style: Style) {
        let Some([from, to]) = self.clipped(from, to) else { return };
        let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil().max(1.0);
        let step = [0, 1].map(|i| (to[i] - from[i]) / steps);
        let [mut x, mut y] = from;
        for _ in 0..=steps as u32 {
            match sign {
                Some(sign) => self.sign([x, y], sign, style),
                None => self.dot(x as usize, y as usize, every, style),
            }
            (x, y) = (x + step[0], y + step[1]);
        }
    }

    /// Draws a dot. Which dots of a line are left out depends on their position, so that two overlapping lines look
    /// like one.
    fn dot(&mut self, x: usize, y: usize, every: usize, style: Style) {
        /// Bits of a cell's dots, in Unicode's order.
        const BITS: [[u8; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];
        let width = usize::from(self.area.width);
        if x / 2 >= width || !(x + y).is_multiple_of(every) {
            return;
        }
        if let Some(cell) = self.cells.get_mut(y / 4 * width + x / 2) {
            cell.bits |= BITS[y % 4][x % 2];
            cell.style = style;
        }
    }

    /// Draws a sign in a cell.
    pub(super) fn sign(&mut self, at: [f64; 2], sign: char, style: Style) {
        if let Some(cell) = self.cell(at[0], at[1]) {
            (cell.sign, cell.style) = (Some(sign), style);
        }
    }

    /// Clips a line to the area.
    fn clipped(&self, from: [f64; 2], to: [f64; 2]) -> Option<[[f64; 2]; 2]> {
        let size = self.size();
        let (mut begin, mut end) = (0.0f64, 1.0f64);
        for i in 0..2 {
            let along = to[i] - from[i];
            if !along.is_finite() {
                return None;
            }
            if along == 0.0 {
                if !(0.0..size[i]).contains(&from[i]) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((0.0 - from[i]) / along, (size[i] - from[i]) / along);
            begin = begin.max(a.min(b));
            end = end.min(a.max(b));
        }
        let at = |share: f64| [0, 1].map(|i| from[i] + share * (to[i] - from[i]));
        (begin <= end).then(|| [at(begin), at(end)])
    }

    /// Writes the canvas to the screen.
    pub(super) fn show(&self, out: &mut Buffer) {
        let width = self.area.width.max(1);
        for (n, cell) in self.cells.iter().enumerate() {
            let dots = char::from_u32(0x2800 + u32::from(cell.bits)).filter(|_| cell.bits != 0);
            let at = (self.area.x + (n % usize::from(width)) as u16, self.area.y + (n / usize::from(width)) as u16);
            if let (Some(sign), Some(place)) = (cell.sign.or(dots), out.cell_mut(at)) {
                place.set_char(sign).set_style(cell.style);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wild_lines_stay_inside_and_a_slope_is_true() {
        let area = Rect::new(3, 2, 4, 2);
        let mut canvas = Canvas::over(area);
        let wild = [f64::NAN, f64::INFINITY, -1e300, 1e300, -1.0, 0.0, 7.9, 8.0, 1e9];
        for a in wild {
            for b in wild {
                canvas.line([a, b], [b, a], 1, None, Style::new());
                canvas.sign([a, b], '@', Style::new());
            }
        }
        let mut out = Buffer::empty(Rect::new(0, 0, 10, 6));
        canvas.show(&mut out);
        for at in out.area.positions().filter(|at| !area.contains(*at)) {
            assert_eq!(out.cell(at).map(ratatui::buffer::Cell::symbol), Some(" "));
        }
        let mut canvas = Canvas::over(area);
        canvas.line([0.0, 0.0], [7.0, 7.0], 1, None, Style::new());
        let bits: Vec<u8> = canvas.cells.iter().map(|cell| cell.bits).collect();
        assert_eq!(bits, [0x11, 0x84, 0, 0, 0, 0, 0x11, 0x84]);
    }
}
