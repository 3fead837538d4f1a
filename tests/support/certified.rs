//! A run that can get a certificate.

use super::{TestFolder, shipped_text};

const RECIPE: &str = "
name = \"all\"
[[step]]
phase = \"characterisation\"
units = [1, 5]
staircase = { to_n = 2.0, step_n = 0.5, repeats = 3 }
[[step]]
phase = \"calibration\"
grid = { x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], spacing_mm = 1.0 }
force_n = 1.0
[[step]]
phase = \"test\"
random = { count = 60, x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], force_n = [0.1, 1.0] }
[accept]
method = \"surrogate\"
location_mean_mm = 1.0
";

/// A complete run on a rig whose instruments have certificates.
pub fn bench() -> TestFolder {
    let rig = shipped_text("rigs/sim.toml").replacen(
        "[load_cell]\n",
        "certificate = { number = \"S-1\", date = \"2026-05-04\", u_mm = 0.01 }\n\n[load_cell]\n\
         certificate = { number = \"K-1\", date = \"2026-05-04\", u_percent = 0.2 }\n",
        1,
    );
    let given = shipped_text("data/example/certificate.toml");
    let bench = TestFolder::with([("r.toml", RECIPE), ("rig.toml", &rig), ("c.toml", &given)]);
    bench.palpate_ends(0, "run r.toml --rig rig.toml --out run --sensor A-7 --design D<1>&co --operator K");
    bench
}
