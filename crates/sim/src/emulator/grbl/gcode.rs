//! Lines of G-code: their words, and their meaning.

use super::errors::GrblError;

/// Letters that accept no negative number.
const NOT_NEGATIVE: [u8; 3] = *b"FNP";
/// Length of an inch, mm.
const INCH_MM: f64 = 25.4;

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
    /// G20: lengths and feeds of lines are in inches. Reports stay in mm, as `$13=0` has it.
    pub inches: bool,
    /// F, mm/min; zero until it is set.
    pub feed_mm_min: f64,
    /// G54, as G10 sets it, mm. It is stored, so a reset doesn't change it.
    pub g54_mm: [f64; 3],
    /// G92, mm.
    pub g92_mm: [f64; 3],
}

impl Modal {
    /// Machine minus work coordinates, mm.
    pub(super) fn offset_mm(&self) -> [f64; 3] {
        std::array::from_fn(|n| self.g54_mm[n] + self.g92_mm[n])
    }

    /// Returns the state after a reset.
    pub(super) fn after_reset(&self) -> Modal {
        Modal { g54_mm: self.g54_mm, ..Modal::default() }
    }
}

impl Default for Modal {
    fn default() -> Self {
        let (incremental, inches) = (false, false);
        let (g54_mm, g92_mm) = ([0.0; 3], [0.0; 3]);
        Modal { motion: MotionMode::Rapid, incremental, inches, feed_mm_min: 0.0, g54_mm, g92_mm }
    }
}

/// Content of a line, as its words alone show it.
#[derive(Debug, Default, PartialEq)]
pub(super) struct GcodeLine {
    motion: Option<MotionMode>,
    action: Option<Action>,
    machine: bool,
    incremental: Option<bool>,
    inches: Option<bool>,
    /// Values by letter, A first.
    values: [Option<f64>; 26],
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Action {
    Dwell,
    /// G10.
    SetG54,
    SetG92,
    /// G92.1.
    ClearG92,
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
                b'X' | b'Y' | b'Z' | b'F' | b'L' | b'N' | b'P' => {
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
        next.inches = self.inches.unwrap_or(next.inches);
        next.feed_mm_min = self.length_mm(b'F', &next).unwrap_or(next.feed_mm_min);
        let moves = self.has_axes();
        let uses = |letter: u8| match letter {
            b'P' => matches!(self.action, Some(Action::Dwell | Action::SetG54)),
            _ => self.action == Some(Action::SetG54),
        };
        if [b'P', b'L'].into_iter().any(|letter| !uses(letter) && self.value(letter).is_some()) {
            return Err(GrblError::UnusedWords);
        }
        let order = match self.action {
            Some(Action::Dwell) if moves => return Err(GrblError::UnusedWords),
            Some(Action::Dwell) => BlockOrder::Dwell(self.value(b'P').ok_or(GrblError::MissingValue)?),
            Some(Action::SetG54 | Action::SetG92) if !moves => return Err(GrblError::NoAxisWords),
            Some(Action::SetG54 | Action::SetG92) if self.motion.is_some() => return Err(GrblError::TwoUseAxes),
            Some(Action::SetG54) => {
                self.set_g54(&mut next, at_mm)?;
                BlockOrder::Nothing
            }
            Some(Action::SetG92) => {
                for (n, at_mm) in at_mm.into_iter().enumerate() {
                    if let Some(value_mm) = self.axis_mm(n, &next) {
                        next.g92_mm[n] = at_mm - next.g54_mm[n] - value_mm;
                    }
                }
                BlockOrder::Nothing
            }
            Some(Action::ClearG92) => {
                next.g92_mm = [0.0; 3];
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
        if self.value(b'P').or(self.value(b'L')).is_some() {
            return Err(GrblError::UnusedWords);
        }
        if !self.has_axes() {
            return Err(GrblError::NoAxisWords);
        }
        let incremental = self.incremental.unwrap_or(modal.incremental);
        let modes = Modal { incremental, inches: self.inches.unwrap_or(modal.inches), ..modal.clone() };
        let feed_mm_min = self.length_mm(b'F', &modes).filter(|&feed| feed > 0.0).ok_or(GrblError::NoFeed)?;
        Ok(BlockOrder::Go { to_mm: self.target_mm(&modes, at_mm), feed_mm_min: Some(feed_mm_min) })
    }

    fn value(&self, letter: u8) -> Option<f64> {
        self.values[usize::from(letter - b'A')]
    }

    /// A length, mm, or a feed, mm/min, which a line may state in inches.
    fn length_mm(&self, letter: u8, modal: &Modal) -> Option<f64> {
        self.value(letter).map(|value| if modal.inches { value * INCH_MM } else { value })
    }

    fn axis_mm(&self, axis: usize, modal: &Modal) -> Option<f64> {
        self.length_mm(b"XYZ"[axis], modal)
    }

    fn has_axes(&self) -> bool {
        b"XYZ".iter().any(|&letter| self.value(letter).is_some())
    }

    /// G10: L2 states where the work coordinates are zero, L20 what the present place counts in them. P is 0 for those that are in
    /// use, or 1 for G54, which are the same here.
    fn set_g54(&self, next: &mut Modal, at_mm: [f64; 3]) -> Result<(), GrblError> {
        let here = match (self.value(b'L').ok_or(GrblError::MissingValue)?, self.value(b'P')) {
            (_, None) => return Err(GrblError::MissingValue),
            (2.0, Some(0.0 | 1.0)) => false,
            (20.0, Some(0.0 | 1.0)) => true,
            _ => return Err(GrblError::Unsupported),
        };
        for (n, at_mm) in at_mm.into_iter().enumerate() {
            if let Some(value_mm) = self.axis_mm(n, next) {
                next.g54_mm[n] = if here { at_mm - next.g92_mm[n] - value_mm } else { value_mm };
            }
        }
        Ok(())
    }

    fn target_mm(&self, modal: &Modal, at_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|n| {
            let Some(value_mm) = self.axis_mm(n, modal) else { return at_mm[n] };
            match (self.machine, modal.incremental) {
                // G53 means absolute, even after G91
                (true, _) => value_mm,
                (false, true) => at_mm[n] + value_mm,
                (false, false) => value_mm + modal.offset_mm()[n],
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
            100 => self.action = Some(Action::SetG54),
            920 => self.action = Some(Action::SetG92),
            921 => self.action = Some(Action::ClearG92),
            530 => self.machine = true,
            distance @ (900 | 910) => self.incremental = Some(distance == 910),
            unit @ (200 | 210) => self.inches = Some(unit == 200),
            // the only modes here
            540 | 940 => {}
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
    fn inches_and_work_coordinates_stay_until_they_are_set_again() {
        let mut modal = Modal::default();
        assert_eq!(run(&mut modal, "G20G91G1Z-0.1F10"), go([1.0, 2.0, 3.0 - 2.54], Some(254.0)));
        assert_eq!(run(&mut modal, "G21G90Z3"), go([1.0, 2.0, 3.0], Some(254.0)));
        assert_eq!(run(&mut modal, "G10L20P1X0Z0"), Ok(BlockOrder::Nothing));
        assert_eq!((modal.offset_mm(), modal.g54_mm), ([1.0, 0.0, 3.0], [1.0, 0.0, 3.0]));
        assert_eq!(run(&mut modal, "G92Z10"), Ok(BlockOrder::Nothing));
        assert_eq!(modal.offset_mm(), [1.0, 0.0, -7.0]);
        assert_eq!(run(&mut modal, "X0Z11"), go([1.0, 2.0, 4.0], Some(254.0)));
        assert_eq!(run(&mut modal, "G10L2P0Z0.5"), Ok(BlockOrder::Nothing));
        assert_eq!(run(&mut modal, "G92.1"), Ok(BlockOrder::Nothing));
        assert_eq!((modal.offset_mm(), modal.after_reset().g54_mm), ([1.0, 0.0, 0.5], [1.0, 0.0, 0.5]));
    }

    #[test]
    fn a_jog_counts_from_the_modes_and_leaves_them() {
        let modal = Modal { g92_mm: [0.5, 0.0, 0.0], ..Modal::default() };
        let jog = |line: &str| GcodeLine::parse(line)?.jog(&modal, AT_MM);
        assert_eq!(jog("X10Y-1.5F100"), go([10.5, -1.5, 3.0], Some(100.0)));
        assert_eq!(jog("G91G21X0.5F10"), go([1.5, 2.0, 3.0], Some(10.0)));
        assert_eq!(jog("G53Y5F100"), go([1.0, 5.0, 3.0], Some(100.0)));
        // whatever another client set, a line that states its modes means the same way
        let modal = Modal { incremental: true, inches: true, g54_mm: [9.0; 3], ..modal };
        let jog = |line: &str| GcodeLine::parse(line)?.jog(&modal, AT_MM);
        assert_eq!(jog("G91G21X0.5F10"), go([1.5, 2.0, 3.0], Some(10.0)));
        assert_eq!(jog("X0.5F10"), go([1.0 + 12.7, 2.0, 3.0], Some(254.0)));
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
            ("G10L3P1X1", GrblError::Unsupported),
            ("G10L20X1", GrblError::MissingValue),
            ("G10L20P1", GrblError::NoAxisWords),
            ("G91L20", GrblError::UnusedWords),
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
