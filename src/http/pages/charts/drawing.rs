//! Drawing charts as SVG files that stand alone: light and dark themes, a title and a description for screen readers.

use std::fmt::Write as _;

use crate::http::pages::html::escaped;

/// Number of series that have a colour and a shape of their own.
pub const SERIES: usize = 5;

/// Colours of all charts. Programs that do not know themes draw the light one.
const STYLE: &str = "\
text{font:13px system-ui,sans-serif;fill:#1b2027}.soft{fill:#535b66}.end{text-anchor:end}.mid{text-anchor:middle}\
.grid{stroke:#d0d5dc}.rule{stroke:#535b66;fill:none}.front{stroke:#1c5fa8;stroke-width:2;fill:none}\
.range{stroke:#1c5fa8;stroke-width:7;stroke-opacity:.35}.point{fill:#1c5fa8}.faint{fill:#535b66;fill-opacity:.45}\
.s0{fill:#1c5fa8}.s1{fill:#b34700}.s2{fill:#1d7a46}.s3{fill:#a0307c}.s4{fill:#5b4bc4}\
.solved{stroke:#1d7a46}.failed{stroke:#e3a19e}.accurate{stroke:#c9a227}.none{stroke:#eef1f5}\
@media(prefers-color-scheme:dark){text{fill:#e6e9ee}.soft{fill:#a9b1bc}.grid{stroke:#3a414b}.rule{stroke:#a9b1bc}\
.front,.range{stroke:#7db6f0}.point,.s0{fill:#7db6f0}.faint{fill:#a9b1bc}.s1{fill:#f2a365}.s2{fill:#5cc98b}.s3{fill:#e58cc6}\
.s4{fill:#b0a6f7}.solved{stroke:#5cc98b}.failed{stroke:#8a3a38}.accurate{stroke:#d9bc54}.none{stroke:#22272f}}";

/// A chart that is being drawn. Units are pixels, from the upper left corner.
pub struct Drawing {
    width: f64,
    height: f64,
    body: String,
}

impl Drawing {
    /// Begins a drawing of this size.
    pub const fn new(width: f64, height: f64) -> Self {
        Self { width, height, body: String::new() }
    }

    /// Draws a line.
    pub fn line(&mut self, class: &str, from: [f64; 2], to: [f64; 2]) {
        let ([x1, y1], [x2, y2]) = (from, to);
        self.add(format_args!(r#"<line class="{class}" x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}"/>"#));
    }

    /// Draws lines from point to point.
    pub fn way(&mut self, class: &str, points: &[[f64; 2]]) {
        let told: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        self.add(format_args!(r#"<polyline class="{class}" points="{}"/>"#, told.join(" ")));
    }

    /// Writes text whose baseline begins, ends or is centred at a point, by the class `end` or `mid`.
    pub fn text(&mut self, class: &str, [x, y]: [f64; 2], text: &str) {
        self.add(format_args!(r#"<text class="{class}" x="{x:.1}" y="{y:.1}">{}</text>"#, escaped(text)));
    }

    /// Writes text that rises to the right from a point.
    pub fn slanted(&mut self, [x, y]: [f64; 2], text: &str) {
        let text = escaped(text);
        self.add(format_args!(
            r#"<text class="soft end" transform="translate({x:.1} {y:.1}) rotate(-50)">{text}</text>"#
        ));
    }

    /// Draws the mark of a series around a point: each has its own shape. Its title appears under the pointer.
    pub fn mark(&mut self, class: &str, series: usize, [x, y]: [f64; 2], title: &str) {
        let (element, place) = match series % SERIES {
            0 => ("circle", format!(r#"cx="{x:.1}" cy="{y:.1}" r="5""#)),
            1 => ("rect", format!(r#"x="{:.1}" y="{:.1}" width="9" height="9""#, x - 4.5, y - 4.5)),
            2 => ("polygon", corners([[x, y - 6.0], [x + 6.0, y + 4.5], [x - 6.0, y + 4.5]])),
            3 => ("polygon", corners([[x, y - 6.5], [x + 6.5, y], [x, y + 6.5], [x - 6.5, y]])),
            _ => ("polygon", corners([[x, y + 6.0], [x + 6.0, y - 4.5], [x - 6.0, y - 4.5]])),
        };
        let title = escaped(title);
        self.add(format_args!(r#"<{element} class="{class}" {place}><title>{title}</title></{element}>"#));
    }

    /// Draws cells of one height in rows: `path` has units of cells, which fill the given rectangle.
    pub fn cells(&mut self, [x, y, width, height]: [f64; 4], [across, down]: [usize; 2], paths: &[(&str, String)]) {
        self.add(format_args!(
            r#"<svg x="{x:.1}" y="{y:.1}" width="{width:.1}" height="{height:.1}" viewBox="0 0 {across} {down}" preserveAspectRatio="none" stroke-width=".84">"#
        ));
        for (class, path) in paths {
            self.add(format_args!(r#"<path class="{class}" d="{path}"/>"#));
        }
        self.add(format_args!("</svg>"));
    }

    /// Ends the drawing.
    pub fn finish(self, title: &str, about: &str) -> String {
        let Self { width, height, body } = self;
        let (title, about) = (escaped(title), escaped(about));
        format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" role="img"><title>{title}</title><desc>{about}</desc><style>{STYLE}</style>{body}</svg>"#
        )
    }

    fn add(&mut self, part: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.body.write_fmt(part);
    }
}

fn corners<const N: usize>(points: [[f64; 2]; N]) -> String {
    format!(r#"points="{}""#, points.map(|[x, y]| format!("{x:.1},{y:.1}")).join(" "))
}

/// Shortens a name to what fits beside a chart.
#[must_use]
pub fn short(name: &str, chars: usize) -> String {
    // Other scripts have wide characters.
    let width = |c: char| if c.is_ascii() || c.is_alphabetic() && (c as u32) < 0x1100 { 1 } else { 2 };
    if name.chars().map(width).sum::<usize>() <= chars {
        return name.to_owned();
    }
    let mut left = chars.saturating_sub(1);
    let fits = |c: &char| {
        left.checked_sub(width(*c)).is_some_and(|rest| {
            left = rest;
            true
        })
    };
    name.chars().take_while(fits).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_agents_are_called_cannot_end_an_element() {
        let mut drawing = Drawing::new(100.0, 50.0);
        drawing.text("soft", [1.0, 2.0], "</text><script>\"&");
        drawing.mark("s0", 0, [1.0, 2.0], "<b>");
        let svg = drawing.finish("a <b>", "");
        assert!(
            svg.contains("&lt;/text&gt;&lt;script&gt;&quot;&amp;") && svg.contains("<title>&lt;b&gt;</title></circle>")
        );
        assert!(!svg.contains("<script") && !svg.contains("<b>"), "{svg}");
    }

    #[test]
    fn long_names_are_shortened_by_characters() {
        assert_eq!(short("строитель", 5), "стро…");
        assert_eq!(short("строитель", 9), "строитель");
        assert_eq!(short("建築家のモデル", 9), "建築家の…");
    }
}
