//! Refused recipes and rigs: one thing is replaced in a valid text.

use RefusedBy::{Program, Schema, Toml};

/// A text that is valid except for one thing.
pub struct Twin {
    /// The replaced text.
    pub from: &'static str,
    /// The new text.
    pub to: &'static str,
    /// The first part that refuses it.
    pub refused_by: RefusedBy,
    /// All parts of the message.
    pub parts: &'static [&'static str],
}

/// The first part that refuses a text; the program refuses all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RefusedBy {
    /// A reader of TOML.
    Toml,
    /// The JSON Schema.
    Schema,
    /// Only the program, by a rule between keys.
    Program,
}

const GRID: &str = "grid = { x_mm = [-2.0, 2.0], y_mm = [-2.0, 2.0], spacing_mm = 4.0 }";
const RANDOM: &str = "random = { count = 2, x_mm = [-2.0, 2.0], y_mm = [-2.0, 2.0], force_n = [0.5, 1.0] }";

/// Variants of [`SMALL`](super::SMALL).
pub const RECIPE_TWINS: [Twin; 16] = [
    Twin {
        from: GRID,
        to: "grid = { x_mm = [-12.0, 13.0], y_mm = [-2.0, 2.0], spacing_mm = 1.0 }",
        refused_by: Program,
        parts: &[
            "(13, -2) mm is outside the stage's travel: x goes from -12.5 to 12.5 mm",
            "r.toml:14:8",
            "keep places within",
        ],
    },
    Twin {
        from: "force_n = 1.0\n",
        to: "force_n = 2.01\n",
        refused_by: Program,
        parts: &["presses with 2.01 N, over the specimen's limit of 2 N", "r.toml:15:11", "use at most 2 N"],
    },
    Twin {
        from: "to_n = 2.0, step_n = 1.0",
        to: "to_n = 2.5, step_n = 0.5",
        refused_by: Program,
        parts: &["presses with 2.5 N, over", "r.toml:10:13"],
    },
    Twin {
        from: "force_n = [0.5, 1.0]",
        to: "force_n = [0.5, 2.5]",
        refused_by: Program,
        parts: &["presses with 2.5 N, over", "r.toml:19:10"],
    },
    Twin {
        from: "force_n = 1.0\n",
        to: "force_n = 1.0\nhold_s = 86401\n",
        refused_by: Schema,
        parts: &["`hold_s` is 86401, must be 0 to 86400 s", "r.toml:16:10"],
    },
    Twin {
        from: "force_n = 1.0\n",
        to: "force_n = 0.05\n",
        refused_by: Program,
        parts: &["tolerance of 0.05 N is not smaller than the force of 0.05 N", "r.toml:15:11"],
    },
    Twin {
        from: "spacing_mm = 4.0",
        to: "spacing_mm = 5.0",
        refused_by: Program,
        parts: &["`spacing_mm` is 5, more than the 4 mm of `x_mm`", "r.toml:14:63"],
    },
    Twin {
        from: "force_n = 1.0\n",
        to: "forc_n = 1.0\n",
        refused_by: Schema,
        parts: &["unknown key `forc_n`", "r.toml:15:1", "did you mean `force_n`?"],
    },
    Twin {
        from: "[press]\n",
        to: "[press]\nhold_ms = 500\n",
        refused_by: Schema,
        parts: &["unknown key `hold_ms` in `press`", "r.toml:5:1", "did you mean `hold_s`?"],
    },
    Twin {
        from: "force_n = 1.0\n",
        to: "force_n = \"1 N\"\n",
        refused_by: Schema,
        parts: &["`force_n` is a string, expected a number in N", "r.toml:15:11", "write only the number"],
    },
    Twin {
        from: GRID,
        to: "grid = {}",
        refused_by: Schema,
        parts: &["`x_mm` is missing in `step.grid`", "`spacing_mm` is missing", "r.toml:14:8"],
    },
    Twin {
        from: RANDOM,
        to: "random = { count = 0, x_mm = [0, 1], y_mm = [0, 1], force_n = [0.5, 1] }",
        refused_by: Schema,
        parts: &["`count` is 0, must be 1 to"],
    },
    Twin {
        from: GRID,
        to: "list = { places_mm = [] }",
        refused_by: Program,
        parts: &["`places_mm` is empty: nothing to press", "r.toml:14:22"],
    },
    Twin {
        from: "force_n = 1.0\n",
        to: "force_n = nan\n",
        refused_by: Program,
        parts: &["`force_n` is not a finite number", "r.toml:15:11"],
    },
    Twin { from: "[press]\n", to: "[press\n", refused_by: Toml, parts: &["not valid TOML", "r.toml:4:7"] },
    Twin {
        from: "units = [5]",
        to: "units = [10]",
        refused_by: Program,
        parts: &["there is no unit 10: the rig's array has 9", "r.toml:9:9"],
    },
];

/// Variants of `rigs/sim.toml`.
pub const RIG_TWINS: [Twin; 8] = [
    Twin {
        from: "link = \"sim\"",
        to: "link = \"tcp://a:502\"",
        refused_by: Program,
        parts: &["some links are simulated and others are real", "rig.toml:", "none"],
    },
    Twin {
        from: "link = \"sim\"",
        to: "link = \"serial:///dev/ttyUSB0\"",
        refused_by: Program,
        parts: &["the baud rate is missing: expected serial://PORT?", "rig.toml:6:8"],
    },
    Twin {
        from: "[limits]",
        to: "[limit]",
        refused_by: Schema,
        parts: &["unknown key `limit`", "did you mean `limits`?"],
    },
    Twin {
        from: "force_n = 2.0",
        to: "force_n = inf",
        refused_by: Schema,
        parts: &["`force_n` is not a finite number"],
    },
    Twin {
        from: "depth_mm = 1.6",
        to: "depth_mm = 16.0",
        refused_by: Program,
        parts: &["pressing takes z from", "stage.travel_mm.z"],
    },
    Twin {
        from: "elastomer = { depth_mm = 5.0 }",
        to: "elastomer = { depth_mm = 5.0, bonded_poisson_ratio = 0.5 }",
        refused_by: Schema,
        parts: &["`bonded_poisson_ratio` is 0.5, must be 0 to 0.4999", "rig.toml:35:54"],
    },
    Twin {
        from: "hysteresis = {",
        to: "taxel_fault = [{ unit = 10, kind = \"dead\" }]\nhysteresis = {",
        refused_by: Program,
        parts: &["there is no unit 10: the rig's array has 9", "rig.toml:40:25"],
    },
    Twin {
        from: "\"labjack-t7\"",
        to: "\"labjack-t8\"",
        refused_by: Program,
        parts: &["there is no register map \"labjack-t8\"", "labjack-t7"],
    },
];
