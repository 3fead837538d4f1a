//! How the numbers of an emulated array follow its outputs.

use palpate_core::quantity::Range;

/// Part of its range that a number moves at the force for which the array is designed: enough to resolve it, and room for more.
const PART_AT_FULL_SCALE: f64 = 0.25;

/// Numbers of an array. 1 N directly above a unit is one output of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::rig) struct ArrayResponse {
    scale: f64,
    offset: f64,
    range: Option<Range>,
    rest: f64,
    per_output: f64,
}

impl ArrayResponse {
    /// Creates numbers of which the rig subtracts `offset`, and multiplies the rest by `scale`. Without a range, the rig's outputs
    /// are those of the scene. Numbers with a range rest at the offset or in the middle, and use a part of the range.
    pub(in crate::rig) fn new(scale: f64, offset: f64, range: Option<Range>, full_scale_n: f64) -> Self {
        let (rest, per_output) = match range {
            None => (offset, 1.0 / scale),
            Some(range) => {
                let moved = PART_AT_FULL_SCALE * range.width();
                let has_room = range.contains(offset - moved) && range.contains(offset + moved);
                let rest = if has_room { offset } else { f64::midpoint(range.min, range.max) };
                (rest, scale.signum() * moved / full_scale_n)
            }
        };
        ArrayResponse { scale, offset, range, rest, per_output }
    }

    /// Returns the number of an output. `is_value`: the output is a value with a unit, such as a temperature, which the rig gets
    /// back as it is.
    pub(super) fn number(&self, output: f64, is_value: bool) -> f64 {
        let number = if is_value { output / self.scale + self.offset } else { self.rest + output * self.per_output };
        // not `clamp`, which has no room for a range without numbers
        self.range.map_or(number, |range| number.max(range.min).min(range.max))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_without_a_range_give_the_outputs_of_the_scene() {
        let response = ArrayResponse::new(-0.5, 10.0, None, 2.0);
        for output in [0.0, 0.25, -3.0] {
            assert_eq!((response.number(output, false) - 10.0) * -0.5, output);
        }
    }

    #[test]
    fn numbers_with_a_range_stay_in_it_and_use_a_part() {
        let counts = Some(Range { min: 0.0, max: 1000.0 });
        let of = |scale, offset, output| ArrayResponse::new(scale, offset, counts, 2.0).number(output, false);
        assert_eq!([of(1.0, 0.0, 0.0), of(1.0, 0.0, 2.0), of(-1.0, 0.0, 2.0)], [500.0, 750.0, 250.0]);
        assert_eq!([of(1.0, 300.0, 0.0), of(0.001, 300.0, 2.0), of(1.0, 300.0, 1e9)], [300.0, 550.0, 1000.0]);
        assert_eq!(ArrayResponse::new(2.0, 5.0, counts, 2.0).number(23.0, true), 16.5);
    }
}
