//! Terms of a `[scene]` that change the readings over time: creep and lag of the taxels, wear, temperature.

use super::scene::wave;
use super::scene_keys::{scene, taxel_creep, temperature, wear};
use palpate_document::{self as document, Problem, Table};
use palpate_sim::scene::{RelaxationBranch, Temperature, Wear};

/// Least time constant of a creep, in time constants of the lag. A creep as fast as the lag can't be distinguished from it.
const LEAST_LAGS: f64 = 2.0;

/// Reads the creep's branches and the lag, s, of the taxels.
pub(super) fn read_creep(scene: &Table) -> Option<(Vec<RelaxationBranch>, Option<f64>)> {
    let lag_s = scene.number(&scene::taxel_lag_s);
    let tables = scene.tables(&scene::taxel_creep);
    let branches = document::all(tables.iter().map(|table| {
        let [share, time_s] = table.numbers([taxel_creep::share, taxel_creep::time_s])?;
        if let Some(lag_s) = lag_s.filter(|lag_s| time_s < LEAST_LAGS * lag_s) {
            let text = format!("`time_s` is {time_s}, under {LEAST_LAGS} times `taxel_lag_s` of {lag_s}");
            table.complain(Problem::new(table.span_of(&taxel_creep::time_s), text));
        }
        Some(RelaxationBranch { share, time_s })
    }))?;
    let sum: f64 = branches.iter().map(|branch| branch.share).sum();
    if let Some(last) = tables.last().filter(|_| sum <= -1.0) {
        let text = format!("all `share` of `taxel_creep` add up to {sum}, must be over -1");
        last.complain(Problem::new(last.span_of(&taxel_creep::share), text));
    }
    Some((branches, lag_s))
}

/// Reads the wear by contacts.
pub(super) fn read_wear(table: &Table) -> Option<Wear> {
    let [gain_per_press, zero_per_press] = table.numbers([wear::gain_per_press, wear::zero_per_press])?;
    let radius_mm = table.number(&wear::radius_mm).unwrap_or(f64::INFINITY);
    Some(Wear { gain_per_press, zero_per_press, radius_mm })
}

/// Reads the temperature over time, and its effects.
pub(super) fn read_temperature(table: &Table) -> Option<Temperature> {
    use temperature as key;
    let over_time = table.numbers([key::mean_c, key::amplitude_c, key::period_s, key::drift_c_h]);
    let reference_c = table.number(&key::reference_c);
    let of_taxels = table.numbers([key::taxel_zero_per_c, key::taxel_gain_per_c]);
    let of_load_cell = table.numbers([key::load_cell_zero_n_per_c, key::load_cell_gain_per_c]);
    let ([mean_c, amplitude_c, period_s, drift_c_h], [taxel_zero_per_c, taxel_gain_per_c]) = (over_time?, of_taxels?);
    let [load_cell_zero_n_per_c, load_cell_gain_per_c] = of_load_cell?;
    Some(Temperature {
        mean_c,
        wave: wave(amplitude_c, period_s),
        drift_c_h,
        reference_c: reference_c.unwrap_or(mean_c),
        taxel_zero_per_c,
        taxel_gain_per_c,
        load_cell_zero_n_per_c,
        load_cell_gain_per_c,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{self, SIM_RIG};
    use palpate_sim::scene::{SceneSpec, Sine};

    const LAST: &str = "array = [1.0, 2.0] }";

    /// The shipped scene with more tables.
    fn with(more: &str) -> Result<SceneSpec, Vec<String>> {
        let text = SIM_RIG.replace(LAST, &format!("{LAST}\n{more}"));
        rig::parse("rig.toml", &text, &|_| unreachable!()).map(|rig| rig.scene).map_err(|problems| problems.lines())
    }

    #[test]
    fn each_term_is_present_if_it_is_named() {
        let plain = with("").unwrap();
        assert_eq!((plain.taxel_creep, plain.taxel_lag_s, plain.wear, plain.temperature), (vec![], None, None, None));
        let creep = "taxel_creep = [{ share = 0.1, time_s = 1.0 }, { share = -0.3, time_s = 1.0 }]";
        let warm = "temperature = { mean_c = 23.0, amplitude_c = 2.0, taxel_gain_per_c = -0.002 }";
        let scene = with(&format!("taxel_lag_s = 0.05\n{creep}\nwear = {{ gain_per_press = -1e-5 }}\n{warm}")).unwrap();
        let branches = [0.1, -0.3].map(|share| RelaxationBranch { share, time_s: 1.0 });
        assert_eq!((scene.taxel_creep, scene.taxel_lag_s), (branches.to_vec(), Some(0.05)));
        assert_eq!(scene.wear, Some(Wear { gain_per_press: -1e-5, zero_per_press: 0.0, radius_mm: f64::INFINITY }));
        let Some(Temperature { mean_c, wave, reference_c, taxel_gain_per_c, .. }) = scene.temperature else { panic!() };
        assert_eq!(wave, Some(Sine { amplitude: 2.0, period_s: 3600.0 }));
        assert_eq!([mean_c, reference_c, taxel_gain_per_c], [23.0, 23.0, -0.002]);
    }

    #[test]
    fn errors_are_reported_at_their_lines() {
        for (more, line) in [
            ("taxel_creep = [{ share = 0.1, time_s = 0.0 }]", "42:40: `time_s` is 0, must be 0.01 to 86400 s"),
            (
                "taxel_creep = [{ share = -0.6, time_s = 1.0 },\n{ share = -0.4, time_s = 9.0 }]",
                "43:11: all `share` of `taxel_creep` add up to -1, must be over -1",
            ),
            (
                "taxel_lag_s = 0.05\ntaxel_creep = [{ share = 0.1, time_s = 0.09 }]",
                "43:40: `time_s` is 0.09, under 2 times `taxel_lag_s` of 0.05",
            ),
            ("wear = { gain_per_press = -2.0 }", "42:27: `gain_per_press` is -2, must be -1 to 1"),
            ("temperature = { drift_c_h = 0.5 }", "42:15: `mean_c` is missing in `scene.temperature`"),
        ] {
            let lines = with(more).expect_err(more);
            assert!(lines.len() == 1 && lines[0].starts_with(&format!("rig.toml:{line}")), "{more}: {lines:?}");
        }
    }
}
