//! Keys of a recipe, table by table.

use super::accept::accept as accept_keys;
use super::{Checks, GridOrder, Manner, OnMiss, PRESSES_CEILING, Phase, SeriesScope};
use palpate_control::Strategy;
use palpate_document::{Bounds, keys, words};
use palpate_solver::{BEST, SOLVERS};

const DAY_S: f64 = 86_400.0;
const UNITS_MAX: u64 = 4096;
const CELLS_MAX: u64 = 10_000;

const PLACE: Bounds = Bounds::within(-1000.0, 1000.0, "mm");
const FORCE: Bounds = Bounds::above(0.0, 100.0, "N");
/// Limits of a force that may be none.
const HELD_FORCE: Bounds = Bounds::within(0.0, 100.0, "N");
const DEPTH: Bounds = Bounds::above(0.0, 100.0, "mm");
const DWELL: Bounds = Bounds::within(0.0, DAY_S, "s");
/// Limits of a window. A shorter window contains fewer than two conversions of a common load cell.
const WINDOW: Bounds = Bounds::within(0.01, DAY_S, "s");
const SLIDE: Bounds = Bounds::above(0.0, 100.0, "mm");
const SLIDE_SPEED: Bounds = Bounds::above(0.0, 100.0, "mm/s");
const DIRECTION: Bounds = Bounds::within(-360.0, 360.0, "degrees");
const SPACING: Bounds = Bounds::above(0.0, 1000.0, "mm");

/// Possible phases of a step.
pub(super) const PHASES: [(&str, Phase); 8] = [
    (Phase::Characterisation.name(), Phase::Characterisation),
    (Phase::Calibration.name(), Phase::Calibration),
    (Phase::Test.name(), Phase::Test),
    (Phase::Creep.name(), Phase::Creep),
    (Phase::Ramp.name(), Phase::Ramp),
    (Phase::Rest.name(), Phase::Rest),
    (Phase::Cycles.name(), Phase::Cycles),
    (Phase::Wave.name(), Phase::Wave),
];
pub(super) const ORDERS: [(&str, GridOrder); 2] =
    [(GridOrder::Raster.name(), GridOrder::Raster), (GridOrder::Interleaved.name(), GridOrder::Interleaved)];
pub(super) const CHECKS: [(&str, Checks); 3] =
    [(Checks::End.name(), Checks::End), (Checks::Between.name(), Checks::Between), (Checks::None.name(), Checks::None)];
pub(super) const ON_MISS: [(&str, OnMiss); 3] =
    [(OnMiss::Retry.name(), OnMiss::Retry), (OnMiss::Flag.name(), OnMiss::Flag), (OnMiss::End.name(), OnMiss::End)];
pub(super) const SCOPES: [(&str, SeriesScope); 3] = [
    (SeriesScope::None.name(), SeriesScope::None),
    (SeriesScope::Window.name(), SeriesScope::Window),
    (SeriesScope::Press.name(), SeriesScope::Press),
];
pub(super) const STRATEGIES: [(&str, Strategy); 3] = [
    (Strategy::Guarded.name(), Strategy::Guarded),
    (Strategy::Velocity.name(), Strategy::Velocity),
    (Strategy::Map.name(), Strategy::Map),
];
/// Whether the force stays, not the depth.
pub(super) const HELD: [(&str, bool); 2] = [("depth", false), ("force", true)];
/// Whether a slip ends the run.
pub(super) const SLIPS: [(&str, bool); 2] = [("record", false), ("trip", true)];
pub(super) const ALL_UNITS: [(&str, ()); 1] = [("all", ())];

/// Names of all solvers, and the name that selects the best solver.
pub(super) const CHOOSABLE: [&str; SOLVERS.len() + 1] = {
    let mut names = [BEST; SOLVERS.len() + 1];
    names.split_at_mut(1).1.copy_from_slice(&SOLVERS);
    names
};

keys! {
    /// The complete recipe.
    root {
        name: Text, Refused, "name of the run folder", "\"paper\"";
        press: Table(&press::KEYS), Allowed, "settings of every press, unless a step overrides them";
        step: Tables(&step::KEYS), Allowed, "the steps, done in this order; at least one is required";
        rig: Text, Allowed, "the rig where no `--rig` is given: a file relative to the recipe, or a shipped rig", "\"rig.toml\"";
        checks: Word(&words(&CHECKS)), or_word(Checks::End.name()),
            "when the first large-force press is repeated, to check load cell and sensor: only after the last press, also between presses, or never",
            "\"between\"";
        on_miss: Word(&words(&ON_MISS)), or_word(OnMiss::Retry.name()),
            "what becomes of a press if the array or a monitor misses a reading: it is made again up to twice, and then the run ends, or its row is flagged without outputs and the run continues; or the run ends at once",
            "\"flag\"";
        record: Table(&record::KEYS), Allowed, "what is kept of a press in addition to the means of its windows";
        evaluate: Table(&evaluate::KEYS), Allowed, "evaluate the run when it is complete";
        accept: Either(&[Table(&accept_keys::KEYS), Text]), Allowed,
            "the acceptance rule, or the name of a file in the recipe's folder that holds it; without it there is no verdict",
            "\"accept.toml\"";
    }
}

keys! {
    /// `[press]`, and the same keys in a step.
    press {
        force_tolerance_n: Number(FORCE), or(Manner::PAPER.force_tolerance_n),
            "largest difference between the force in the window and the set force", "0.05";
        depth_tolerance_mm: Number(DEPTH), or(Manner::PAPER.depth_tolerance_mm),
            "largest difference between depth and set depth, in presses by depth", "0.02";
        hold_s: Number(DWELL), or(Manner::PAPER.hold_s), "dwell at the set force or depth before the window", "0.5";
        sample_s: Number(WINDOW), or(Manner::PAPER.sample_s),
            "length of the window in which force and outputs are sampled", "0.1";
        strategy: Word(&words(&STRATEGIES)), or_word(Manner::PAPER.strategy.name()), "strategy that reaches the force", "\"map\"";
        sample_after_s: Number(DWELL), Allowed,
            "time from contact to the start of the window; without it, the window starts when the force is within the tolerance", "2.0";
        follow_s: Number(DWELL), Allowed,
            "time after the last window for which all devices are read at rest, in the phases creep and rest; needs `record.series`", "600.0";
    }
}

keys! {
    /// `[record]`
    record {
        series: Word(&words(&SCOPES)), or_word(SeriesScope::None.name()),
            "readings that are kept, each with its time: none, those of the windows, or those of the whole press; needs a build with the feature `files`",
            "\"press\"";
    }
}

keys! {
    /// `[evaluate]`
    evaluate {
        solvers: Words(&CHOOSABLE), or_texts(&[SOLVERS[0]]), "the solvers to evaluate the run with",
            "[\"pearson\", \"pearson-lsq\"]";
    }
}

keys! {
    /// `[[step]]`
    step {
        phase: Word(&words(&PHASES)), Refused, "purpose of the step's presses", "\"calibration\"";
        force_n: Number(FORCE), Allowed,
            "force of every press; a step has this, `depth_mm`, `staircase`, `random.force_n` or `random.depth_mm`", "1.0";
        depth_mm: Numbers(DEPTH), Allowed,
            "depth of every press below the surface that it touches, or several depths for each place", "[0.2, 0.4, 0.6]";
        staircase: Table(&staircase::KEYS), Allowed, "load to a force and unload, in equal steps";
        holds: Word(&words(&HELD)), or_word("depth"),
            "what stays in the phase creep while it is followed: the depth, or the force, which is restored every second", "\"force\"";
        ramps_mm_s: Numbers(SLIDE_SPEED), Allowed,
            "in the phase ramp, speeds at which the tip leaves the specimen and comes back to where it was held; all devices are read meanwhile",
            "[0.1, 1.0]";
        cycles: Table(&cycles::KEYS), Allowed, "press with `force_n` many times at each place, in the phase cycles";
        wave: Table(&wave::KEYS), Allowed, "forces one after another, in the phase wave; all devices are read meanwhile";
        drag: Table(&drag::KEYS), Allowed,
            "after the window, drag the tip sideways in contact, one press for each direction; the rig must allow it in `limits.drag`";
    }
    as press { force_tolerance_n, depth_tolerance_mm, hold_s, sample_s, strategy, sample_after_s, follow_s }
    one of {
        grid: Table(&grid::KEYS), Allowed, "places on a regular grid, both ends included";
        cells: Table(&cells::KEYS), Allowed, "places at the centres of equal cells";
        list: Table(&list::KEYS), Allowed, "places given as a list";
        random: Table(&random::KEYS), Allowed, "random places, from the run's random seed";
        units: Either(&[Word(&words(&ALL_UNITS)), Wholes(1, UNITS_MAX)]), Allowed,
            "places above the centres of these units (numbered from 1), or of all units", "[1, 5, 9]";
    }
}

keys! {
    /// `drag` of a step.
    drag {
        mm: Number(SLIDE), Refused, "way in contact; with `shear_n` the longest one", "0.5";
        shear_n: Number(FORCE), Allowed, "force sideways at which the drag ends; without it, it goes all the way", "0.3";
        directions_deg: Numbers(DIRECTION), Refused, "directions, from x towards y: one press for each", "[0, 90, 180, 270]";
        speed_mm_s: Number(SLIDE_SPEED), or(0.5), "speed of the drag", "0.5";
        slip: Word(&words(&SLIPS)), or_word("record"), "what a slip does: it is recorded, or it ends the run", "\"trip\"";
    }
}

keys! {
    /// `cycles` of a step.
    cycles {
        presses: Whole(1, PRESSES_CEILING as u64), Refused, "number of presses at each place", "10000";
        reference_every: Whole(1, PRESSES_CEILING as u64), or_whole(100),
            "presses after which the reference place is pressed; it is also pressed before the first and after the last", "100";
        reference_mm: Places(PLACE), Refused, "the reference place, which wears little: it shows the drift of the rig", "[[5.0, 5.0]]";
    }
}

keys! {
    /// `wave` of a step.
    wave {
        force_n: Numbers(HELD_FORCE), Refused, "the forces; 0 is without load", "[0.2, 0.8, 0.4, 0.0]";
        for_s: Numbers(DWELL), Refused, "time for which each force stays, or one time for all", "5.0";
    }
}

keys! {
    /// `grid` of a step.
    grid {
        x_mm: Range(PLACE), Refused, "first and last x", "[-6.0, 6.0]";
        y_mm: Range(PLACE), Refused, "first and last y", "[-6.0, 6.0]";
        spacing_mm: Number(SPACING), Refused, "distance of neighbouring places; both extents must be multiples of it", "0.5";
        order: Word(&words(&ORDERS)), or_word(GridOrder::Raster.name()), "order in which the places are pressed",
            "\"interleaved\"";
    }
}

keys! {
    /// `cells` of a step.
    cells {
        x_mm: Range(PLACE), Refused, "interval of x that the cells divide", "[-6.0, 6.0]";
        y_mm: Range(PLACE), Refused, "interval of y that the cells divide", "[-6.0, 6.0]";
        columns: Whole(1, CELLS_MAX), Refused, "number of cells along x", "3";
        rows: Whole(1, CELLS_MAX), Refused, "number of cells along y", "3";
    }
}

keys! {
    /// `list` of a step.
    list {
        places_mm: Places(PLACE), Refused, "the places", "[[0.0, 0.0], [1.5, -2.0]]";
    }
}

keys! {
    /// `random` of a step.
    random {
        count: Whole(1, PRESSES_CEILING as u64), Refused, "number of places", "100";
        x_mm: Range(PLACE), Refused, "interval of x", "[-6.0, 6.0]";
        y_mm: Range(PLACE), Refused, "interval of y", "[-6.0, 6.0]";
        force_n: Range(FORCE), Allowed, "interval of the random force of each place", "[0.1, 1.0]";
        depth_mm: Range(DEPTH), Allowed, "interval of the random depth of each place, instead of a force", "[0.1, 0.8]";
    }
}

keys! {
    /// `staircase` of a step.
    staircase {
        to_n: Number(FORCE), Refused, "the largest force", "2.0";
        step_n: Number(FORCE), Refused, "difference of neighbouring levels; `to_n` must be a multiple of it", "0.5";
        repeats: Whole(1, 1000), or_whole(1), "number of repeats at each place", "5";
        rest_s: Number(DWELL), or(0.0), "rest between two repeats at a place", "300.0";
    }
}

#[cfg(test)]
mod tests {
    use crate::recipe::{KEYS, parse};
    use palpate_document::sample::assert_read_is_listed;

    #[test]
    fn recipe_reader_reads_exactly_the_listed_keys() {
        assert_read_is_listed(&KEYS, |text| drop(parse("recipe.toml", text)));
    }
}
