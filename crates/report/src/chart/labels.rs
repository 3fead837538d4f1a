//! Positions the texts of a figure without overlap: by rank, then in the order they were added.
//!
//! Main texts of a figure are always shown ([`Rank::Fixed`]: the author ensures that there is space). A number of an axis is
//! omitted if its place is occupied; its grid line remains. Words next to a mark move up or down to the next free place, with a
//! line to their mark. Without a free place they are omitted.

use super::escaped;
use super::letters::width_px;
use std::fmt::Write as _;

/// Priority of a text over other texts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum LabelRank {
    /// Text at a fixed position.
    Fixed,
    /// Number next to an axis.
    Tick,
    /// Words next to a mark, and the position of the mark, px.
    Word((f64, f64)),
}

/// Text at a point, px.
#[derive(Clone, Debug)]
pub(super) struct Label {
    /// Position on the baseline: start, middle or end of the text, depending on the class.
    pub at: (f64, f64),
    /// Appearance: classes of the style sheet.
    pub class: &'static str,
    pub text: String,
    pub rank: LabelRank,
    /// Whether the text runs upward.
    pub is_upright: bool,
}

/// Height of letters above their baseline, as a fraction of their size. The second constant is their depth below it.
const ASCENT: f64 = 0.9;
const DESCENT: f64 = 0.24;
/// Least distance of two texts along a line, px.
const APART_PX: f64 = 3.0;
/// Step by which words are moved, px. The second constant is the largest number of steps.
const STEP_PX: f64 = 15.0;
const MOST_STEPS: usize = 10;
/// Ratio of the width of bold letters to that of normal ones.
pub(super) const BOLD: f64 = 1.12;

/// Rectangle, px.
#[derive(Clone, Copy, Debug)]
struct LabelBox {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
}

impl LabelBox {
    fn meets(&self, other: &LabelBox) -> bool {
        self.left < other.right + APART_PX
            && other.left < self.right + APART_PX
            && self.top < other.bottom
            && other.top < self.bottom
    }
}

impl Label {
    /// Creates a text at a fixed position.
    pub(super) fn fixed(at: (f64, f64), class: &'static str, text: &str) -> Label {
        Label { at, class, text: text.to_owned(), rank: LabelRank::Fixed, is_upright: false }
    }

    /// Creates a number next to an axis.
    pub(super) fn tick(at: (f64, f64), class: &'static str, text: &str) -> Label {
        Label { rank: LabelRank::Tick, ..Label::fixed(at, class, text) }
    }

    /// Size of the text's letters, px, as in the style sheet.
    fn size_px(&self) -> f64 {
        let has = |word: &str| self.class.split(' ').any(|class| class == word);
        if has("title") {
            17.0
        } else if has("small") {
            12.0
        } else if has("word") {
            11.5
        } else {
            SIZE_PX
        }
    }

    fn frame(&self) -> LabelBox {
        let has = |word: &str| self.class.split(' ').any(|class| class == word);
        let size = self.size_px();
        let length = width_px(&self.text, size) * if has("title") || has("head") { BOLD } else { 1.0 };
        let start = if has("mid") { -length / 2.0 } else { -length * f64::from(u8::from(has("end"))) };
        let (x, y) = self.at;
        if self.is_upright {
            let (left, right) = (x - ASCENT * size, x + DESCENT * size);
            return LabelBox { left, right, top: y - start - length, bottom: y - start };
        }
        LabelBox { left: x + start, right: x + start + length, top: y - ASCENT * size, bottom: y + DESCENT * size }
    }

    /// Returns the text moved to the right and down, px.
    fn moved(&self, (right, down): (f64, f64)) -> Label {
        Label { at: (self.at.0 + right, self.at.1 + down), ..self.clone() }
    }

    /// Returns the text moved sideways so that it stays inside the figure.
    fn within(&self, width: f64) -> Label {
        let LabelBox { left, right, .. } = self.frame();
        let too_far_right = (right - width + 1.0).max(0.0);
        self.moved(((1.0 - left).max(0.0) - if left < 1.0 { 0.0 } else { too_far_right }, 0.0))
    }

    fn write(&self, svg: &mut String) {
        let ((x, y), words) = (self.at, escaped(&self.text));
        let _ = match self.is_upright {
            true => {
                let class = self.class;
                writeln!(
                    svg,
                    "<text class=\"{class}\" transform=\"translate({x:.1} {y:.1}) rotate(-90)\">{words}</text>"
                )
            }
            false => writeln!(svg, "<text class=\"{}\" x=\"{x:.1}\" y=\"{y:.1}\">{words}</text>", self.class),
        };
    }
}

/// Size of letters without an explicit size, px.
pub(super) const SIZE_PX: f64 = 13.0;

/// Returns all texts of a figure of this width as SVG.
pub(super) fn laid_out(labels: &[Label], width: f64) -> String {
    let (mut svg, mut taken) = (String::new(), Vec::<LabelBox>::new());
    let of = |is: fn(&LabelRank) -> bool| labels.iter().filter(move |label| is(&label.rank) && !label.text.is_empty());
    for label in of(|rank| matches!(rank, LabelRank::Fixed)) {
        let label = label.within(width);
        taken.push(label.frame());
        label.write(&mut svg);
    }
    for label in of(|rank| matches!(rank, LabelRank::Tick)) {
        let label = label.within(width);
        if taken.iter().all(|other| !other.meets(&label.frame())) {
            taken.push(label.frame());
            label.write(&mut svg);
        }
    }
    for label in of(|rank| matches!(rank, LabelRank::Word(_))) {
        let downs = (1..=MOST_STEPS).flat_map(|step| [-(step as f64), step as f64]).map(|steps| steps * STEP_PX);
        let places = std::iter::once(0.0).chain(downs).map(|down| label.moved((0.0, down)).within(width));
        let is_free = |label: &Label| {
            let frame = label.frame();
            frame.top >= 0.0 && taken.iter().all(|other| !other.meets(&frame))
        };
        let Some(free) = places.into_iter().find(is_free) else { continue };
        if let LabelRank::Word(mark) = label.rank
            && (free.at.1 - label.at.1).abs() > 1.5 * STEP_PX
        {
            lead(&mut svg, mark, free.frame());
        }
        taken.push(free.frame());
        free.write(&mut svg);
    }
    svg
}

/// Draws a line from a mark to the nearest side of words.
fn lead(svg: &mut String, (x, y): (f64, f64), words: LabelBox) {
    let (to_x, to_y) = (x.clamp(words.left, words.right), y.clamp(words.top, words.bottom));
    let _ = writeln!(svg, "<line class=\"lead\" x1=\"{x:.1}\" y1=\"{y:.1}\" x2=\"{to_x:.1}\" y2=\"{to_y:.1}\"/>");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn word(at: (f64, f64), text: &str) -> Label {
        Label { rank: LabelRank::Word(at), ..Label::fixed(at, "word", text) }
    }

    #[test]
    fn overlapping_numbers_are_dropped_and_words_move() {
        let title = Label::fixed((50.0, 50.0), "mid", "a title");
        let number = Label::tick((60.0, 52.0), "mid", "7.5");
        let far = Label::tick((160.0, 52.0), "mid", "8.5");
        let svg = laid_out(&[number, word((50.0, 50.0), "words"), far, title], 200.0);
        assert!(svg.contains("a title") && svg.contains("8.5") && !svg.contains("7.5"), "{svg}");
        assert!(svg.contains("y=\"50.0\">a title") && svg.contains("y=\"35.0\">words"), "{svg}");
    }

    #[test]
    fn many_words_at_one_place_are_separated_or_left_out() {
        let words: Vec<Label> = (0..40).map(|_| word((50.0, 60.0), "words")).collect();
        let svg = laid_out(&words, 200.0);
        let mut heights: Vec<f64> =
            svg.split("y=\"").skip(1).filter_map(|rest| rest.split('"').next()?.parse().ok()).collect();
        heights.sort_by(f64::total_cmp);
        assert!(heights.len() > 5 && heights.windows(2).all(|pair| pair[1] - pair[0] > 12.0), "{heights:?}");
        assert!(svg.contains("class=\"lead\""));
    }

    #[test]
    fn label_outside_the_figure_is_moved_inside() {
        for (at, class) in [((198.0, 20.0), "mid"), ((2.0, 20.0), "mid"), ((3.0, 20.0), "end")] {
            let LabelBox { left, right, .. } = Label::fixed(at, class, "long words").within(200.0).frame();
            assert!(left >= 1.0 - 1e-9 && right <= 199.0 + 1e-9, "{left} {right}");
        }
    }

    #[test]
    fn an_upright_text_takes_its_length_upward() {
        let label = Label { is_upright: true, ..Label::fixed((20.0, 100.0), "mid", "upright") };
        let frame = label.frame();
        assert!(frame.bottom - frame.top > 40.0 && frame.right - frame.left < 16.0, "{frame:?}");
        assert!(((frame.bottom + frame.top) / 2.0 - 100.0).abs() < 1e-9);
    }
}
