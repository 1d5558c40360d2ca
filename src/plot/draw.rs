//! Lays out and draws a plot.

use super::canvas::{Align, Canvas, Color, Place, shift, text_width};
use super::ticks::{Label, Ticks, linear, logarithmic};
use super::{Axis, Plot, Scale, Series, Stroke};

const INK: Color = [38, 40, 44];
const GRID: Color = [222, 225, 229];
const FAINT: Color = [240, 241, 243];
const PAPER: Color = [255; 3];
/// Okabe and Ito, "Color universal design" (2008), in an order whose neighbours differ most.
const COLORS: [Color; 7] =
    [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167], [230, 159, 0], [86, 180, 233], [60, 60, 60]];

/// Where the axes lie, and how data become pixels.
struct Frame {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    x: Ticks,
    y: Ticks,
    scales: [Scale; 2],
    /// Height of a line of text [px].
    text: f64,
}

impl Frame {
    fn new(plot: &Plot, width: f64, height: f64) -> Self {
        let text = (height / 40.0).clamp(13.0, 40.0);
        let top = if plot.title.is_empty() { 1.2 * text } else { 3.0 * text };
        let bottom = height - 3.6 * text;
        let y = ticks(plot, &plot.y, 1, ((bottom - top) / (4.0 * text)) as usize, true);
        let widest = y.major.iter().map(|(_, label)| label_width(label, text)).fold(0.0, f64::max);
        let left = widest + 2.9 * text;
        let right = width - 1.8 * text;
        let x = ticks(plot, &plot.x, 0, ((right - left) / (7.0 * text)) as usize, false);
        Self { left, right, top, bottom, x, y, scales: [plot.x.scale, plot.y.scale], text }
    }

    fn place(&self, [x, y]: [f64; 2]) -> Place {
        let share = |value: f64, [low, high]: [f64; 2], scale: Scale| match scale {
            Scale::Linear => (value - low) / (high - low),
            Scale::Logarithmic => (value.log10() - low.log10()) / (high.log10() - low.log10()),
        };
        let [across, up] = [share(x, self.x.range, self.scales[0]), share(y, self.y.range, self.scales[1])];
        [self.left + across * (self.right - self.left), self.bottom - up * (self.bottom - self.top)]
    }
}

fn ticks(plot: &Plot, axis: &Axis, part: usize, wanted: usize, widen: bool) -> Ticks {
    let values = || plot.series.iter().flat_map(|series| &series.points).map(|point| point[part]);
    let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
    match axis.scale {
        Scale::Linear => linear(low, high, wanted.max(2), widen),
        Scale::Logarithmic => logarithmic(low, high, wanted.max(2)),
    }
}

pub(super) fn draw(plot: &Plot, width: u32, height: u32) -> image::RgbImage {
    let mut canvas = Canvas::new(width, height, PAPER);
    let frame = Frame::new(plot, f64::from(width), f64::from(height));
    axes(&mut canvas, plot, &frame);
    for (series, color) in plot.series.iter().zip(COLORS.iter().cycle()) {
        let places: Vec<Place> = series.points.iter().map(|&point| frame.place(point)).collect();
        stroke(&mut canvas, &places, series.stroke, frame.text, *color);
    }
    legend(&mut canvas, plot, &frame);
    canvas.picture
}

/// Draws the points of a series.
fn stroke(canvas: &mut Canvas, places: &[Place], stroke: Stroke, text: f64, color: Color) {
    let lines: Vec<[Place; 2]> = places.windows(2).map(|pair| [pair[0], pair[1]]).collect();
    let dots: Vec<[Place; 2]> = places.iter().map(|&place| [place, place]).collect();
    match stroke {
        Stroke::Line | Stroke::Marked => canvas.lines(&lines, text / 8.0, color, 1.0),
        Stroke::Dashed => canvas.lines(&dashes(&lines, 0.5 * text), text / 12.0, color, 1.0),
        Stroke::Discs | Stroke::Rings => {}
    }
    match stroke {
        Stroke::Rings => {
            canvas.lines(&dots, 1.1 * text, color, 1.0);
            canvas.lines(&dots, 0.85 * text, PAPER, 1.0);
        }
        Stroke::Marked | Stroke::Discs => canvas.lines(&dots, 0.5 * text, color, 1.0),
        Stroke::Line | Stroke::Dashed if places.len() == 1 => canvas.lines(&dots, 0.5 * text, color, 1.0),
        Stroke::Line | Stroke::Dashed => {}
    }
}

/// Every other piece of some lines, each piece about this long [px].
fn dashes(lines: &[[Place; 2]], length: f64) -> Vec<[Place; 2]> {
    let of = |&[a, b]: &[Place; 2]| {
        let pieces = (((b[0] - a[0]).hypot(b[1] - a[1]) / length).min(1e4).ceil() as usize).max(1);
        let at = move |n: usize| [0, 1].map(|i| a[i] + (b[i] - a[i]) * n as f64 / pieces as f64);
        (0..pieces).step_by(2).map(move |n| [at(n), at(n + 1)])
    };
    lines.iter().flat_map(of).collect()
}

fn axes(canvas: &mut Canvas, plot: &Plot, frame: &Frame) {
    let &Frame { left, right, top, bottom, text, .. } = frame;
    // One pixel wide, on whole pixels: crisp.
    let mut upright = |x: f64, color: Color| canvas.fill([x.floor(), top], [x.floor() + 1.0, bottom], color, 1.0);
    frame.x.minor.iter().for_each(|&x| upright(frame.place([x, frame.y.range[0]])[0], FAINT));
    frame.x.major.iter().for_each(|(x, _)| upright(frame.place([*x, frame.y.range[0]])[0], GRID));
    let mut level = |y: f64, color: Color| canvas.fill([left, y.floor()], [right, y.floor() + 1.0], color, 1.0);
    frame.y.minor.iter().for_each(|&y| level(frame.place([frame.x.range[0], y])[1], FAINT));
    frame.y.major.iter().for_each(|(y, _)| level(frame.place([frame.x.range[0], *y])[1], GRID));
    let (l, b) = (left.floor(), bottom.floor());
    canvas.fill([l - 1.0, top], [l + 1.0, b + 1.0], INK, 1.0);
    canvas.fill([l - 1.0, b - 1.0], [right, b + 1.0], INK, 1.0);

    for (x, label) in &frame.x.major {
        let x = frame.place([*x, frame.y.range[0]])[0];
        canvas.fill([x.floor(), b], [x.floor() + 1.0, b + 0.4 * text], INK, 1.0);
        draw_label(canvas, label, [x, bottom + 1.05 * text], text, Align::Center);
    }
    for (y, label) in &frame.y.major {
        let y = frame.place([frame.x.range[0], *y])[1];
        canvas.fill([l - 0.4 * text, y.floor()], [l, y.floor() + 1.0], INK, 1.0);
        draw_label(canvas, label, [left - 0.6 * text, y], text, Align::Right);
    }
    let middle = |a: f64, b: f64| f64::midpoint(a, b);
    let caption = |axis: &Axis, ticks: &Ticks| match ticks.exponent {
        0 => axis.caption(),
        exponent if axis.unit.is_empty() => format!("{} [1e{exponent}]", axis.label),
        exponent => format!("{} [1e{exponent} {}]", axis.label, axis.unit),
    };
    let x_caption = [middle(left, right), bottom + 2.6 * text];
    canvas.text(&caption(&plot.x, &frame.x), x_caption, 1.1 * text, Align::Center, INK);
    canvas.text_upward(&caption(&plot.y, &frame.y), [1.1 * text, middle(top, bottom)], 1.1 * text, INK);
    canvas.text(&plot.title, [middle(left, right), 1.5 * text], 1.35 * text, Align::Center, INK);
}

const POWER_SIZE: f64 = 0.75;

fn label_width(label: &Label, text: f64) -> f64 {
    match label {
        Label::Number(number) => text_width(number, text),
        Label::Power(power) => text_width("10", text) + text_width(&power.to_string(), POWER_SIZE * text),
    }
}

fn draw_label(canvas: &mut Canvas, label: &Label, place: Place, text: f64, align: Align) {
    let left = place[0] - shift(align, label_width(label, text));
    match label {
        Label::Number(number) => canvas.text(number, [left, place[1]], text, Align::Left, INK),
        Label::Power(power) => {
            canvas.text("10", [left, place[1]], text, Align::Left, INK);
            let raised = [left + text_width("10", text), place[1] - 0.4 * text];
            canvas.text(&power.to_string(), raised, POWER_SIZE * text, Align::Left, INK);
        }
    }
}

/// Draws the names of several lines in the corner where they hide the least.
fn legend(canvas: &mut Canvas, plot: &Plot, frame: &Frame) {
    if plot.series.len() < 2 {
        return;
    }
    let text = frame.text;
    let widest = plot.series.iter().map(|series| text_width(&series.name, text)).fold(0.0, f64::max);
    let (width, height) = (widest + 4.0 * text, (1.4 * plot.series.len() as f64 + 0.6) * text);
    let gap = 0.7 * text;
    let corners = [
        [frame.right - width - gap, frame.top + gap],
        [frame.left + gap, frame.top + gap],
        [frame.right - width - gap, frame.bottom - height - gap],
        [frame.left + gap, frame.bottom - height - gap],
    ];
    let hidden = |&[x, y]: &Place| {
        let inside = |p: Place| p[0] >= x && p[0] <= x + width && p[1] >= y && p[1] <= y + height;
        let along = |pair: &[[f64; 2]]| {
            let (a, b) = (frame.place(pair[0]), frame.place(pair[pair.len() - 1]));
            (0..8).filter(|&part| inside([0, 1].map(|i| a[i] + (b[i] - a[i]) * f64::from(part) / 8.0))).count()
        };
        let of = |series: &Series| match series.stroke.joins() {
            true => series.points.windows(2).map(along).sum::<usize>(),
            // A mark hides as much as a piece of line.
            false => series.points.iter().filter(|&&point| inside(frame.place(point))).count() * 8,
        };
        plot.series.iter().map(of).sum::<usize>()
    };
    let [x, y] = corners.into_iter().min_by_key(hidden).unwrap_or(corners[0]);
    canvas.fill([x - 1.0, y - 1.0], [x + width + 1.0, y + height + 1.0], GRID, 1.0);
    canvas.fill([x, y], [x + width, y + height], PAPER, 1.0);
    for (row, (series, color)) in plot.series.iter().zip(COLORS.iter().cycle()).enumerate() {
        let middle = y + (1.4 * row as f64 + 1.0) * text;
        let (from, to) = ([x + 0.7 * text, middle], [x + 2.7 * text, middle]);
        let place = [f64::midpoint(from[0], to[0]), middle];
        if series.stroke.joins() {
            stroke(
                canvas,
                &[from, to],
                if series.stroke == Stroke::Dashed { Stroke::Dashed } else { Stroke::Line },
                text,
                *color,
            );
        }
        if matches!(series.stroke, Stroke::Marked | Stroke::Discs | Stroke::Rings) {
            let mark = if series.stroke == Stroke::Marked { Stroke::Discs } else { series.stroke };
            stroke(canvas, &[place], mark, text, *color);
        }
        canvas.text(&series.name, [x + 3.3 * text, middle], text, Align::Left, INK);
    }
}
