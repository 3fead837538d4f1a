//! Newport XPS: three positioners in one or more groups as a stage, and an analog input of the same controller as a load cell.

use super::{Beside, DeviceFamily, Links, NEWTON_PER_VOLT, NEWTON_PER_VOLT_MEANS, Role, as_a, read_newton_per_volt};
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{Dial, Driver, LastResort, LoadCellDriver, Misfit, RigSpec, RigWiring, StageDriver};
use palpate_document::{Problem, Table, keys};
use palpate_drivers::xps::{Grouping, Guard, PositionerName, Xps, XpsAnalog};
use palpate_drivers::{AnyLoadCell, AnyStage};
use palpate_link::device::DeviceError;
use palpate_sim::emulator;
use palpate_sim::scene::{Scene, SceneDevice};
use std::sync::Arc;

pub(super) const FAMILY: DeviceFamily = DeviceFamily {
    name: "xps",
    meaning: "Newport XPS: three positioners in any groups, an analog input",
    simulated: "an XPS-Q8 with three VP-25XL axes, an input, a guard",
    stage: Some(Role { words: &[], keys: stage::KEYS.always, links: Links::Stream, read: read_stage }),
    load_cell: Some(Role { words: &[], keys: load_cell::KEYS.always, links: Links::Stream, read: read_load_cell }),
    array: None,
};

/// Position of the axes after their search for home (VP-25XL: its switch is in the middle), mm.
const HOME_MM: f64 = 0.0;

keys! {
    /// `driver = { xps = ... }` of a stage.
    stage {
        xps: Either(&[Text, Texts]), Refused, "the XPS' group of three positioners, or a list of its groups", "\"XYZ\"";
        positioners: Texts, or_texts(&["X", "Y", "Z"]),
            "the positioners of x, y and z, in this order; with several groups each as GROUP.POSITIONER. Those of one group \
            must be in this order in the controller too",
            "[\"XY.X\", \"XY.Y\", \"Z.Pos\"]";
        home_search: Flag, or_flag(false), "whether palpate may home the groups; their way must be clear of the specimen",
            "true";
        guard: Flag, or_flag(false), "whether the controller also stops a motion at the force limit", "true";
    }
}

keys! {
    /// `driver = { xps = ... }` of a load cell.
    load_cell {
        xps: Text, Refused, "the analog input", "\"GPIO2.ADC1\"";
        newton_per_volt: Number(NEWTON_PER_VOLT), Refused, NEWTON_PER_VOLT_MEANS, "1.0";
    }
}

#[derive(Debug)]
struct XpsStageSpec {
    grouping: Grouping,
    /// Whether the controller itself must end a motion at the force limit.
    guard: bool,
}

#[derive(Debug)]
struct XpsLoadCellSpec(Guard);

fn read_stage(table: &Table, _: Beside) -> Option<Arc<dyn StageDriver>> {
    let groups = match table.is_list(&stage::xps) {
        true => table.texts(&stage::xps),
        false => table.text(&stage::xps).map(|group| vec![group]),
    };
    let positioners = groups.zip(table.texts(&stage::positioners)).and_then(|(groups, names)| {
        let positioners = positioners(&groups, &names);
        let help = "for example xps = [\"XY\", \"Z\"] with positioners = [\"XY.X\", \"XY.Y\", \"Z.Pos\"]";
        positioners
            .map_err(|words| table.complain(Problem::new(table.span_of(&stage::positioners), words).help(help)))
            .ok()
    });
    let (home_search, guard) = (table.flag(&stage::home_search), table.flag(&stage::guard));
    let grouping = Grouping { positioners: positioners?, home_search: home_search? };
    Some(Arc::new(XpsStageSpec { grouping, guard: guard? }))
}

/// Returns the positioners of x, y and z with their groups, or the mistake.
fn positioners<'a>(groups: &[&'a str], names: &[&'a str]) -> Result<[PositionerName; 3], String> {
    let places = names.iter().map(|name| place(name, groups)).collect::<Result<Vec<_>, _>>()?;
    if let Some(twice) = (1..places.len()).find(|&n| places[..n].contains(&places[n])) {
        return Err(format!("\"{}\" is the positioner of two axes", names[twice]));
    }
    if let Some(unused) = groups.iter().find(|group| places.iter().all(|(of_it, _)| of_it != *group)) {
        return Err(format!("the group \"{unused}\" of `xps` has none of the positioners"));
    }
    let positioners = places.into_iter().map(|(group, name)| PositionerName { group: group.into(), name: name.into() });
    let positioners: Result<[PositionerName; 3], _> = positioners.collect::<Vec<_>>().try_into();
    positioners.map_err(|_| "`positioners` names its positioners of x, y and z, in this order".to_owned())
}

/// Returns the group and the positioner of a name. With one group, the name needs none.
fn place<'a>(name: &'a str, groups: &[&'a str]) -> Result<(&'a str, &'a str), String> {
    match (name.split_once('.'), groups) {
        (Some((group, name)), _) if groups.contains(&group) => Ok((group, name)),
        (Some((group, _)), _) => Err(format!("the group \"{group}\" of \"{name}\" isn't among those of `xps`")),
        (None, [group]) => Ok((group, name)),
        (None, _) => Err(format!("\"{name}\" doesn't name its group, and `xps` lists several")),
    }
}

fn read_load_cell(table: &Table, _: Beside) -> Option<Arc<dyn LoadCellDriver>> {
    let input = table.text(&load_cell::xps).map(str::to_owned);
    let newton_per_volt = read_newton_per_volt(table, &load_cell::newton_per_volt);
    Some(Arc::new(XpsLoadCellSpec(Guard { input: input?, newton_per_volt: newton_per_volt? })))
}

/// Returns the load cell if it is on an XPS.
fn cell_of(rig: &RigSpec) -> Option<&XpsLoadCellSpec> {
    as_a(&*rig.load_cell.driver)
}

impl Driver for XpsStageSpec {
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        let misfit = |text: &str, help| Misfit { role: SceneDevice::Stage, text: text.to_owned(), help: Some(help) };
        let mut misfits = Vec::new();
        if self.grouping.home_search && rig.frame.z_from_stage(HOME_MM) > rig.clear_mm() {
            misfits.push(misfit(
                "`home_search` moves z to 0, the middle of its travel, which isn't clear of the specimen",
                "mount the specimen so that `surface_mm` is beyond 0, or home the group by hand, without the specimen",
            ));
        }
        if self.guard && cell_of(rig).is_none() {
            misfits.push(misfit(
                "`guard` requires a load cell on one of the XPS's inputs",
                "remove `guard`, or also wire the cell to GPIO2",
            ));
        }
        misfits
    }
}

impl StageDriver for XpsStageSpec {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        let guard = cell_of(rig).filter(|_| self.guard).map(|cell| cell.0.clone());
        let link = rig.stage.link.to_string();
        AnyStage::Xps(Box::new(Xps::new(|| dial.link(), link, self.grouping.clone(), guard)))
    }

    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice {
        let volts_per_newton = cell_of(rig).map_or(1.0, |cell| 1.0 / cell.0.newton_per_volt);
        let positioners = self.grouping.positioners.each_ref().map(|each| (each.group.as_str(), each.name.as_str()));
        EmulatedDevice::network(emulator::XpsEmulator::new(scene, positioners, volts_per_newton), "xps")
    }

    fn last_resort(&self) -> LastResort {
        LastResort::CutsPower("GroupKill")
    }
}

impl Driver for XpsLoadCellSpec {
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        if as_a::<XpsStageSpec>(&*rig.stage.driver).is_some() && rig.stage.link == rig.load_cell.link {
            return Vec::new();
        }
        let text = "the load cell is on another XPS than the stage".to_owned();
        vec![Misfit { role: SceneDevice::LoadCell, text, help: Some("use the same link and an xps driver for both") }]
    }
}

impl LoadCellDriver for XpsLoadCellSpec {
    fn open(&self, dial: Dial, wiring: &RigWiring) -> Result<AnyLoadCell, DeviceError> {
        let Guard { input, newton_per_volt } = &self.0;
        let cell = &wiring.rig.load_cell;
        let (link, hz) = (cell.link.to_string(), cell.conversions_hz);
        Ok(AnyLoadCell::Xps(XpsAnalog::new(dial.link(), link, input, *newton_per_volt, hz, wiring.origin)))
    }

    /// Returns another socket of the stage's own controller.
    fn emulated(&self, _: &RigSpec, stage: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError> {
        Ok(stage.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(groups: &[&str], names: &[&str]) -> Result<Vec<String>, String> {
        let positioners = positioners(groups, names)?;
        Ok(positioners.iter().map(|each| format!("{}.{}", each.group, each.name)).collect())
    }

    #[test]
    fn positioners_are_read_with_their_groups() {
        for (groups, names, read_as) in [
            (&["XYZ"][..], ["X", "Y", "Z"], ["XYZ.X", "XYZ.Y", "XYZ.Z"]),
            (&["XYZ"], ["XYZ.X", "Y", "XYZ.Z"], ["XYZ.X", "XYZ.Y", "XYZ.Z"]),
            (&["XY", "Z"], ["XY.X", "XY.Y", "Z.Pos"], ["XY.X", "XY.Y", "Z.Pos"]),
            (&["A", "B", "C"], ["C.Pos", "A.Pos", "B.Pos"], ["C.Pos", "A.Pos", "B.Pos"]),
        ] {
            assert_eq!(read(groups, &names).unwrap(), read_as);
        }
        for (groups, names, text) in [
            (&["XY", "Z"][..], &["X", "Y", "Z"][..], "\"X\" doesn't name its group"),
            (&["XY", "Z"], &["XY.X", "XY.Y", "ZZ.Pos"], "the group \"ZZ\" of \"ZZ.Pos\" isn't among those of `xps`"),
            (&["XY", "Z"], &["XY.X", "XY.X", "Z.Pos"], "\"XY.X\" is the positioner of two axes"),
            (&["XYZ", "Z"], &["XYZ.X", "XYZ.Y", "XYZ.Z"], "the group \"Z\" of `xps` has none of the positioners"),
            (&["XYZ"], &["X", "Y"], "names its positioners of x, y and z"),
            (&[], &[], "names its positioners of x, y and z"),
        ] {
            let error = read(groups, names).unwrap_err();
            assert!(error.contains(text), "{error}");
        }
    }
}
