//! The calls that concern groups and their positioners.

use super::controller::{CallReply, Controller, tell};
use super::errors::Code;
use super::group::{EmulatedGroup, GroupStatus, XpsObject, object};
use super::positioner::{self, EmulatedPositioner, SGamma};
use super::syntax::{Call, Type, numbers};
use crate::scene::Scene;

impl Controller {
    /// Runs calls of a group, and calls of a group or one positioner.
    pub(super) fn run_group(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<CallReply, Code> {
        let name = call.name;
        if name == "GroupStatusStringGet" {
            let text = GroupStatus::text(call.whole()?);
            return tell(call, Type::Char, text);
        }
        if !["GroupPositionCurrentGet", "GroupPositionSetpointGet", "GroupMoveAbsolute", "GroupMoveRelative"]
            .contains(&name)
        {
            return self.run_whole_group(call, scene, now_s);
        }
        let (group, index) = match object(&self.groups, call.text()?)? {
            XpsObject::Group(group) => (group, None),
            XpsObject::Positioner(group, index) => (group, Some(index)),
        };
        let group = &mut self.groups[group];
        let each = index.map_or(0..group.positioners.len(), |index| index..index + 1);
        match name {
            "GroupMoveAbsolute" | "GroupMoveRelative" => {
                let mut numbers = vec![None; group.positioners.len()];
                for index in each {
                    numbers[index] = Some(call.number()?);
                }
                call.end()?;
                let move_so = if name == "GroupMoveAbsolute" { EmulatedGroup::move_to } else { EmulatedGroup::move_by };
                move_so(group, &numbers, scene, now_s).map(CallReply::from)
            }
            _ => {
                call.results(Type::Double, each.len())?;
                let count_mm = |positioner: &EmulatedPositioner| match name {
                    "GroupPositionSetpointGet" => positioner.setpoint_mm(scene, now_s),
                    _ => positioner.count_mm(scene, now_s),
                };
                Ok(CallReply::Values(numbers(group.positioners[each].iter().map(count_mm))))
            }
        }
    }

    /// Runs calls of a complete group.
    fn run_whole_group(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<CallReply, Code> {
        let name = call.name;
        let XpsObject::Group(group) = object(&self.groups, call.text()?)? else { return Err(Code::WRONG_OBJECT) };
        let group = &mut self.groups[group];
        if name == "GroupStatusGet" {
            let status = group.status().to_string();
            return tell(call, Type::Int, &status);
        }
        call.end()?;
        match name {
            "GroupKill" => {
                group.kill(scene, now_s);
                Ok(().into())
            }
            "GroupInitialize" => group.initialize(false, scene, now_s).map(CallReply::from),
            "GroupInitializeWithEncoderCalibration" => group.initialize(true, scene, now_s).map(CallReply::from),
            "GroupHomeSearch" => group.home_search(scene, now_s).map(CallReply::from),
            "GroupMoveAbort" => group.abort(scene, now_s).map(CallReply::from),
            "GroupMotionEnable" | "GroupMotionDisable" => {
                group.enable(name == "GroupMotionEnable").map(CallReply::from)
            }
            _ => Err(Code::UNKNOWN_COMMAND),
        }
    }

    /// Runs calls of one positioner.
    pub(super) fn run_positioner(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<CallReply, Code> {
        let name = call.name;
        if name == "PositionerErrorStringGet" {
            call.whole()?;
            // no positioner here has errors
            return tell(call, Type::Char, "");
        }
        if name == "PositionerHardwareStatusStringGet" {
            let text = positioner::hardware_text(call.whole()? as u32);
            return tell(call, Type::Char, &text);
        }
        let XpsObject::Positioner(group, index) = object(&self.groups, call.text()?)? else {
            return Err(Code::WRONG_OBJECT);
        };
        let group = &mut self.groups[group];
        let positioner = &mut group.positioners[index];
        match name {
            "PositionerSGammaParametersGet" => {
                call.results(Type::Double, 4)?;
                let SGamma { speed_mm_s, acceleration_mm_s2, jerk_s } = positioner.s_gamma;
                Ok(CallReply::Values(numbers([speed_mm_s, acceleration_mm_s2, jerk_s.0, jerk_s.1])))
            }
            "PositionerSGammaParametersSet" => {
                let (speed_mm_s, acceleration_mm_s2) = (call.number()?, call.number()?);
                let s_gamma = SGamma { speed_mm_s, acceleration_mm_s2, jerk_s: (call.number()?, call.number()?) };
                call.end()?;
                if !s_gamma.is_sound() {
                    return Err(Code::OUT_OF_RANGE);
                }
                positioner.s_gamma = s_gamma;
                Ok(().into())
            }
            "PositionerMaximumVelocityAndAccelerationGet" => {
                call.results(Type::Double, 2)?;
                Ok(CallReply::Values(numbers([positioner::SPEED_MOST_MM_S, positioner::ACCELERATION_MOST_MM_S2])))
            }
            "PositionerUserTravelLimitsGet" => {
                call.results(Type::Double, 2)?;
                Ok(CallReply::Values(numbers([positioner.limits_mm.0, positioner.limits_mm.1])))
            }
            "PositionerUserTravelLimitsSet" => {
                let limits_mm = (call.number()?, call.number()?);
                call.end()?;
                group.limit(index, limits_mm).map(CallReply::from)
            }
            "PositionerErrorGet" => tell(call, Type::Int, "0"),
            "PositionerHardwareStatusGet" => {
                let status = positioner.hardware_status(scene, now_s) as i32;
                tell(call, Type::Int, &status.to_string())
            }
            _ => Err(Code::UNKNOWN_COMMAND),
        }
    }
}
