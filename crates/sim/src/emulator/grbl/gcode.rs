//! Lines of G-code: their words, and their meaning.

use super::fault::GrblError;

/// Letters that accept no negative number.
const NOT_NEGATIVE: [u8; 3] = *b"FNP";

/// Motion mode of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum MotionMode {
    /// G0: at the largest rate.
    Rapid,
    /// G1: at the feed rate.
    Feed,
}

/// Modal state of the parser, limited to the part that affects motions.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Modal {
    /// G0 or G1.
    pub motion: MotionMode,
    /// G91.
    pub incremental: bool,
    /// F, mm/min; zero until it is set.
    pub feed_mm_min: f64,
    /// G92: machine minus work coordinates, mm.
    pub g92_mm: [f64; 3],
}

impl Default for Modal {
    fn default() -> Self {
        Modal { motion: MotionMode::Rapid, incremental: false, feed_mm_min: 0.0, g92_mm: [0.0; 3] }
    }
}

/// Content of a line, as its words alone show it.
#[derive(Debug, Default, PartialEq)]
pub(super) struct GcodeLine {
    motion: Option<MotionMode>,
    action: Option<Action>,
    machine: bool,
    incremental: Option<bool>,
    /// Values by letter, A first.
    values: [Option<f64>; 26],
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Action {
    Dwell,
    SetG92,
}

/// The meaning of a line.
#[derive(Debug, PartialEq)]
pub(super) enum BlockOrder {
    /// No action that takes time.
    Nothing,
    /// Motion to a place in machine coordinates, mm, at a feed, mm/min, or as fast as possible.
    Go { to_mm: [f64; 3], feed_mm_min: Option<f64> },
    /// G4, s.
    Dwell(f64),
}

impl GcodeLine {
    /// Parses the words of a line: letters and numbers, nothing between.
    pub(super) fn parse(line: &str) -> Result<GcodeLine, GrblError> {
        let mut block = GcodeLine::default();
        let mut rest = line.as_bytes();
        while let Some((&letter, after)) = rest.split_first() {
            if !letter.is_ascii_uppercase() {
                return Err(GrblError::ExpectedLetter);
            }
            let (value, left) = number(after).ok_or(GrblError::BadNumber)?;
            rest = left;
            match letter {
                b'G' => block.take_g(value)?,
                b'X' | b'Y' | b'Z' | b'F' | b'N' | b'P' => {
                    if value < 0.0 && NOT_NEGATIVE.contains(&letter) {
                        return Err(GrblError::NegativeValue);
                    }
                    let slot = &mut block.values[usize::from(letter - b'A')];
                    if slot.replace(value).is_some() {
                        return Err(GrblError::RepeatedWord);
                    }
                }
                _ => return Err(GrblError::Unsupported),
            }
        }
        Ok(block)
    }

    /// The seconds of a G4.
    pub(super) fn dwell_s(&self) -> Option<f64> {
        self.value(b'P').filter(|_| self.action == Some(Action::Dwell))
    }

    /// Updates the modal state and returns the resulting action. `at_mm` is the end of the motions so far, in machine
    /// coordinates. After an error the modal state is unchanged.
    pub(super) fn execute(&self, modal: &mut Modal, at_mm: [f64; 3]) -> Result<BlockOrder, GrblError> {
        let mut next = modal.clone();
        next.motion = self.motion.unwrap_or(next.motion);
        next.incremental = self.incremental.unwrap_or(next.incremental);
        next.feed_mm_min = self.value(b'F').unwrap_or(next.feed_mm_min);
        let moves = self.has_axes();
        if self.action != Some(Action::Dwell) && self.value(b'P').is_some() {
            return Err(GrblError::UnusedWords);
        }
        let order = match self.action {
            Some(Action::Dwell) if moves => return Err(GrblError::UnusedWords),
            Some(Action::Dwell) => BlockOrder::Dwell(self.value(b'P').ok_or(GrblError::MissingValue)?),
            Some(Action::SetG92) if !moves => return Err(GrblError::NoAxisWords),
            Some(Action::SetG92) if self.motion.is_some() => return Err(GrblError::TwoUseAxes),
            Some(Action::SetG92) => {
                for (n, at_mm) in at_mm.into_iter().enumerate() {
                    if let Some(value) = self.axis(n) {
                        next.g92_mm[n] = at_mm - value;
                    }
                }
                BlockOrder::Nothing
            }
            None if !moves => BlockOrder::Nothing,
            None => {
                let feeds = next.motion == MotionMode::Feed;
                if feeds && next.feed_mm_min == 0.0 {
                    return Err(GrblError::NoFeed);
                }
                let feed_mm_min = feeds.then_some(next.feed_mm_min);
                BlockOrder::Go { to_mm: self.target_mm(&next, at_mm), feed_mm_min }
            }
        };
        *modal = next;
        Ok(order)
    }

    /// Returns the action of a `$J=` line. The line uses the modal state but doesn't change it.
    pub(super) fn jog(&self, modal: &Modal, at_mm: [f64; 3]) -> Result<BlockOrder, GrblError> {
        if self.action.is_some() || self.motion.is_some() {
            return Err(GrblError::BadJog);
        }
        if self.value(b'P').is_some() {
            return Err(GrblError::UnusedWords);
        }
        if !self.has_axes() {
            return Err(GrblError::NoAxisWords);
        }
        let modes = Modal { incremental: self.incremental.unwrap_or(modal.incremental), ..modal.clone() };
        let feed_mm_min = self.value(b'F').filter(|&feed| feed > 0.0).ok_or(GrblError::NoFeed)?;
        Ok(BlockOrder::Go { to_mm: self.target_mm(&modes, at_mm), feed_mm_min: Some(feed_mm_min) })
    }

    fn value(&self, letter: u8) -> Option<f64> {
        self.values[usize::from(letter - b'A')]
    }

    fn axis(&self, axis: usize) -> Option<f64> {
        self.value(b"XYZ"[axis])
    }

    fn has_axes(&self) -> bool {
        (0..3).any(|axis| self.axis(axis).is_some())
    }

    fn target_mm(&self, modal: &Modal, at_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|n| {
            let Some(value_mm) = self.axis(n) else { return at_mm[n] };
            match (self.machine, modal.incremental) {
                // G53 means absolute, even after G91
                (true, _) => value_mm,
                (false, true) => at_mm[n] + value_mm,
                (false, false) => value_mm + modal.g92_mm[n],
            }
        })
    }

    fn take_g(&mut self, value: f64) -> Result<(), GrblError> {
        // in tenths: G92.1 is one word
        let tenths = (value * 10.0).round();
        if !(0.0..=1000.0).contains(&tenths) || (tenths - value * 10.0).abs() > 1e-6 {
            return Err(GrblError::Unsupported);
        }
        match tenths as u16 {
            0 => self.motion = Some(MotionMode::Rapid),
            10 => self.motion = Some(MotionMode::Feed),
            40 => self.action = Some(Action::Dwell),
            920 => self.action = Some(Action::SetG92),
            530 => self.machine = true,
            distance @ (900 | 910) => self.incremental = Some(distance == 910),
            // the only modes here, stated for other controllers
            210 | 940 => {}
            _ => return Err(GrblError::Unsupported),
        }
        Ok(())
    }
}

/// Parses a number at the front (a sign, digits, a point, no exponent). Returns it with the rest of the text.
pub(super) fn number(text: &[u8]) -> Option<(f64, &[u8])> {
    let sign = usize::from(matches!(text.first(), Some(b'+' | b'-')));
    let length = text[sign..].iter().take_while(|&&byte| byte.is_ascii_digit() || byte == b'.').count();
    let (number, rest) = text.split_at(sign + length);
    Some((std::str::from_utf8(number).ok()?.parse().ok()?, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT_MM: [f64; 3] = [1.0, 2.0, 3.0];

    fn run(modal: &mut Modal, line: &str) -> Result<BlockOrder, GrblError> {
        GcodeLine::parse(line)?.execute(modal, AT_MM)
    }

    fn go(to_mm: [f64; 3], feed_mm_min: Option<f64>) -> Result<BlockOrder, GrblError> {
        Ok(BlockOrder::Go { to_mm, feed_mm_min })
    }

    #[test]
    fn modes_stay_until_another_of_their_group() {
        let mut modal = Modal::default();
        assert_eq!(run(&mut modal, "X5"), go([5.0, 2.0, 3.0], None));
        assert_eq!(run(&mut modal, "G1G91Z-1F300"), go([1.0, 2.0, 2.0], Some(300.0)));
        assert_eq!(run(&mut modal, "X1"), go([2.0, 2.0, 3.0], Some(300.0)));
        assert_eq!(run(&mut modal, "G53G0X1"), go([1.0, 2.0, 3.0], None));
        assert_eq!(run(&mut modal, "G90X4"), go([4.0, 2.0, 3.0], None));
        assert_eq!(run(&mut modal, "G21G92X0"), Ok(BlockOrder::Nothing));
        assert_eq!(run(&mut modal, "X1"), go([2.0, 2.0, 3.0], None));
        assert_eq!(run(&mut modal, "G92X1Y2Z3"), Ok(BlockOrder::Nothing));
        assert_eq!(run(&mut modal, "G4P1.5"), Ok(BlockOrder::Dwell(1.5)));
        assert_eq!(run(&mut modal, "G21G94"), Ok(BlockOrder::Nothing));
        assert_eq!(modal, Modal { feed_mm_min: 300.0, ..Modal::default() });
    }

    #[test]
    fn a_jog_counts_from_the_modes_and_leaves_them() {
        let modal = Modal { g92_mm: [0.5, 0.0, 0.0], ..Modal::default() };
        let jog = |line: &str| GcodeLine::parse(line)?.jog(&modal, AT_MM);
        assert_eq!(jog("X10Y-1.5F100"), go([10.5, -1.5, 3.0], Some(100.0)));
        assert_eq!(jog("G91G21X0.5F10"), go([1.5, 2.0, 3.0], Some(10.0)));
        assert_eq!(jog("G53Y5F100"), go([1.0, 5.0, 3.0], Some(100.0)));
        for (line, fault) in [
            ("X1", GrblError::NoFeed),
            ("X1F0", GrblError::NoFeed),
            ("F100", GrblError::NoAxisWords),
            ("G1X1F100", GrblError::BadJog),
            ("G92X1F100", GrblError::BadJog),
            ("X1F100P5", GrblError::UnusedWords),
            ("X1X2F100", GrblError::RepeatedWord),
            ("X1F-100", GrblError::NegativeValue),
        ] {
            assert_eq!(jog(line), Err(fault), "{line}");
        }
    }

    #[test]
    fn unknown_word_changes_no_mode() {
        for (line, fault) in [
            ("5", GrblError::ExpectedLetter),
            ("X", GrblError::BadNumber),
            ("X1.2.3", GrblError::BadNumber),
            ("G1X1", GrblError::NoFeed),
            ("G2X1", GrblError::Unsupported),
            ("G91Q1", GrblError::Unsupported),
            ("G80", GrblError::Unsupported),
            ("G20", GrblError::Unsupported),
            ("G91G4", GrblError::MissingValue),
            ("G91P1", GrblError::UnusedWords),
            ("G91G92", GrblError::NoAxisWords),
            ("G91G0G92X1", GrblError::TwoUseAxes),
            ("G59.1", GrblError::Unsupported),
            ("M99", GrblError::Unsupported),
            ("G1.23", GrblError::Unsupported),
        ] {
            let mut modal = Modal::default();
            assert_eq!(run(&mut modal, line), Err(fault), "{line}");
            assert_eq!(modal, Modal::default(), "{line}");
        }
    }
}
