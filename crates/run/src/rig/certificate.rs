//! Statements of a rig about the accuracy of its instruments: `certificate` of `[stage]`, `certificate` and `check` of
//! `[load_cell]`.

use super::keys::{axes_check, certificate, check, stage_certificate};
use palpate_core::quantity::{
    AxesCheck, GAIN_OFF_MOST, LoadCellCertificate, StageCertificate, StatedError, TemperatureEffect, WeightCheck,
};
use palpate_document::{Key, Problem, Table};

/// Longest number of a certificate, characters.
const NUMBER_MAX: usize = 64;

pub(super) fn read_certificate(table: &Table) -> Option<LoadCellCertificate> {
    let number = read_number(table, &certificate::number);
    let date = table.day(&certificate::date).map(str::to_owned);
    let (stated, temperature) = (read_stated(table), read_temperature_effect(table));
    Some(LoadCellCertificate { number: number?, date: date?, stated: stated?, temperature: temperature? })
}

/// Reads the change of the sensitivity with the temperature; the inner value is `None` if it isn't stated.
fn read_temperature_effect(table: &Table) -> Option<Option<TemperatureEffect>> {
    let keys = [certificate::temperature_percent_per_c, certificate::calibrated_at_c];
    if keys.iter().all(|key| !table.has(key)) {
        return Some(None);
    }
    let is_complete = keys.iter().all(|key| table.require(key));
    let [percent_per_c, calibrated_at_c] = if is_complete { table.numbers(keys)? } else { return None };
    Some(Some(TemperatureEffect { percent_per_c, calibrated_at_c }))
}

pub(super) fn read_stage_certificate(table: &Table) -> Option<StageCertificate> {
    let number = read_number(table, &stage_certificate::number);
    let date = table.day(&stage_certificate::date).map(str::to_owned);
    let [u_mm, k] = table.numbers([stage_certificate::u_mm, stage_certificate::k])?;
    Some(StageCertificate { number: number?, date: date?, u_mm, k })
}

pub(super) fn read_check(table: &Table) -> Option<WeightCheck> {
    let numbers = table.numbers([check::weight_n, check::weight_u_n, check::gain, check::gain_sd]);
    let (times, date) = (table.whole(&check::times), table.day(&check::date).map(str::to_owned));
    let (pull, adjusted) = (table.flag(&check::pull), table.flag(&check::adjusted));
    let ([weight_n, weight_u_n, gain, gain_sd], adjusted) = (numbers?, adjusted?);
    if adjusted && (gain - 1.0).abs() > GAIN_OFF_MOST {
        let (least, most) = (1.0 - GAIN_OFF_MOST, 1.0 + GAIN_OFF_MOST);
        let text = format!("`gain` is {gain} with `adjusted`, but only gains of {least} to {most} are adjusted");
        let help = "any other gain is a fault: check the cell's range, units and sign, then run `palpate doctor` again";
        table.complain(Problem::new(table.span_of(&check::gain), text).help(help));
        return None;
    }
    let times = u32::try_from(times?).ok()?;
    Some(WeightCheck { weight_n, weight_u_n, pull: pull?, gain, gain_sd, times, date: date?, adjusted })
}

pub(super) fn read_axes_check(table: &Table) -> Option<AxesCheck> {
    let (along, u) = (table.matrix(&axes_check::along), table.number(&axes_check::u));
    let date = table.day(&axes_check::date).map(str::to_owned);
    Some(AxesCheck { along: along?, u: u?, date: date? })
}

/// Reads the error in the one form in which a certificate states it.
fn read_stated(table: &Table) -> Option<StatedError> {
    let [u_n, u_percent, class_percent] =
        [certificate::u_n, certificate::u_percent, certificate::class_percent].map(|key| table.has(&key));
    let k = table.number(&certificate::k);
    let is_scaled = table.has(&certificate::full_scale_n);
    let full_scale_n = table.number(&certificate::full_scale_n);
    if is_scaled && !class_percent {
        let text = "`full_scale_n` requires `class_percent`";
        table.complain(Problem::new(table.span_of(&certificate::full_scale_n), text));
        return None;
    }
    match (u_n, u_percent, class_percent) {
        (true, false, false) => Some(StatedError::Expanded { u_n: table.number(&certificate::u_n)?, k: k? }),
        (false, true, false) => {
            Some(StatedError::Relative { u_percent: table.number(&certificate::u_percent)?, k: k? })
        }
        (false, false, true) => {
            let class_percent = table.number(&certificate::class_percent);
            if !table.require(&certificate::full_scale_n) {
                return None;
            }
            Some(StatedError::Class { class_percent: class_percent?, full_scale_n: full_scale_n? })
        }
        _ => {
            let text = "`certificate` must state the error of a reading in one way";
            let help = "add one of u_n, u_percent (expanded uncertainty) or class_percent with full_scale_n";
            table.complain(Problem::new(table.span(), text).help(help));
            None
        }
    }
}

/// Reads a certificate's number.
fn read_number(table: &Table, key: &Key) -> Option<String> {
    let number = table.text(key)?;
    if (1..=NUMBER_MAX).contains(&number.chars().count()) && !number.contains(char::is_control) {
        return Some(number.to_owned());
    }
    let words = format!("`{}` is {number:?}, expected 1 to {NUMBER_MAX} printable characters", key.name);
    table.complain(Problem::new(table.span_of(key), words));
    None
}

#[cfg(test)]
mod tests {
    use super::super::{RigSpec, SIM_RIG, parse};
    use super::*;

    fn read(more: &str) -> Result<RigSpec, Vec<String>> {
        let text = SIM_RIG.replacen("[array]", &format!("{more}\n\n[array]"), 1);
        parse("rig.toml", &text, &|_| unreachable!()).map_err(|problems| problems.lines())
    }

    #[test]
    fn a_certificate_is_read_in_each_way_to_state_an_error() {
        let stated = |stated: &str| {
            let text = format!("certificate = {{ number = \"K-7\", date = \"2026-05-04\", {stated} }}");
            read(&text).unwrap().load_cell.certificate.unwrap()
        };
        let plain = stated("u_n = 0.002");
        assert_eq!((plain.number.as_str(), plain.date.as_str()), ("K-7", "2026-05-04"));
        assert_eq!(plain.stated, StatedError::Expanded { u_n: 0.002, k: 2.0 });
        assert_eq!(stated("u_percent = 0.2, k = 1").stated, StatedError::Relative { u_percent: 0.2, k: 1.0 });
        let class = StatedError::Class { class_percent: 0.1, full_scale_n: 5.0 };
        assert_eq!(stated("class_percent = 0.1, full_scale_n = 5").stated, class);
        assert!(read("").unwrap().load_cell.certificate.is_none());
        assert_eq!(plain.temperature, None);
        let text = "certificate = { number = \"K-7\", date = \"2026-05-04\", u_n = 0.002, temperature_percent_per_c = 0.02, \
                    calibrated_at_c = 21 }";
        let temperature = read(text).unwrap().load_cell.certificate.unwrap().temperature;
        assert_eq!(temperature, Some(TemperatureEffect { percent_per_c: 0.02, calibrated_at_c: 21.0 }));
    }

    #[test]
    fn a_check_is_read() {
        let text = "check = { weight_n = 0.5, weight_u_n = 0.0005, gain = 1.0101, gain_sd = 0.0002, times = 3, \
                    date = \"2026-05-04\", adjusted = true }";
        let check = read(text).unwrap().load_cell.check.unwrap();
        let date = "2026-05-04".to_owned();
        let (weight_n, weight_u_n, gain, gain_sd) = (0.5, 0.0005, 1.0101, 0.0002);
        let expected = WeightCheck { weight_n, weight_u_n, pull: false, gain, gain_sd, times: 3, date, adjusted: true };
        assert_eq!(check, expected);
    }

    #[test]
    fn wrong_certificates_and_checks_are_refused() {
        let ways = "`certificate` must state the error of a reading in one way";
        for (keys, text) in [
            (
                "number = \"\", date = \"2026-05-04\", u_n = 1.0",
                "`number` is \"\", expected 1 to 64 printable characters",
            ),
            (
                "number = \"7\", date = \"4.5.2026\", u_n = 1.0",
                "`date` is \"4.5.2026\", expected a day as year-month-day, \"2026-05-04\"",
            ),
            (
                "number = \"7\", date = \"2026-02-30\", u_n = 1.0",
                "`date` is \"2026-02-30\", expected a day as year-month-day, \"2026-05-04\"",
            ),
            ("number = \"7\", date = \"2026-05-04\"", ways),
            ("number = \"7\", date = \"2026-05-04\", u_n = 1.0, u_percent = 1.0", ways),
            ("number = \"7\", date = \"2026-05-04\", u_n = 0.0", "`u_n` is 0, must be over 0, at most 10000 N"),
            ("number = \"7\", date = \"2026-05-04\", u_n = 1.0, k = 0", "`k` is 0, must be 1 to 5"),
            (
                "number = \"7\", date = \"2026-05-04\", class_percent = 0.1",
                "`full_scale_n` is missing in `load_cell.certificate`: a number in N, over 0, at most 10000",
            ),
            (
                "number = \"7\", date = \"2026-05-04\", u_n = 1.0, full_scale_n = 5.0",
                "`full_scale_n` requires `class_percent`",
            ),
            (
                "number = \"7\", date = \"2026-05-04\", u_n = 1.0, calibrated_at_c = 21",
                "`temperature_percent_per_c` is missing in `load_cell.certificate`: a number in %/degree Celsius, 0 to 10",
            ),
            (
                "number = \"7\", date = \"2026-05-04\", u_n = 1.0, temperature_percent_per_c = 0.02",
                "`calibrated_at_c` is missing in `load_cell.certificate`: a number in degrees Celsius, -50 to 150",
            ),
        ] {
            let problems = read(&format!("certificate = {{ {keys} }}")).unwrap_err();
            assert!(problems.len() == 1 && problems[0].ends_with(text), "{keys}: {problems:?}");
            assert!(problems[0].starts_with("rig.toml:"), "{problems:?}");
        }
        let rest = "weight_u_n = 0.0005, gain_sd = 0.0002, times = 3, date = \"2026-05-04\"";
        for (keys, text) in [
            ("weight_n = 0.5", "`gain` is missing in `load_cell.check`: a number, -1000000 to 1000000"),
            ("weight_n = 0.0, gain = 1.0", "`weight_n` is 0, must be over 0, at most 10000 N"),
            (
                "weight_n = 0.5, gain = 1.25, adjusted = true",
                "`gain` is 1.25 with `adjusted`, but only gains of 0.9 to 1.1 are adjusted",
            ),
        ] {
            let problems = read(&format!("check = {{ {keys}, {rest} }}")).unwrap_err();
            assert!(problems.len() == 1 && problems[0].ends_with(text), "{keys}: {problems:?}");
        }
    }
}
