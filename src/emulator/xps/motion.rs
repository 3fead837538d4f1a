//! The calls that concern the group and its positioners.

use super::controller::{Answer, Controller, tell};
use super::errors::Code;
use super::group::{Group, Object, State};
use super::positioner::{self, Positioner, SGamma};
use super::syntax::{Call, Type, numbers};
use crate::scene::Scene;

impl Controller {
    /// Runs calls of the group, and calls of the group or one positioner.
    pub(super) fn run_group(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<Answer, Code> {
        let name = call.name;
        if name == "GroupStatusStringGet" {
            let text = State::text(call.whole()?);
            return tell(call, Type::Char, text);
        }
        if !["GroupPositionCurrentGet", "GroupMoveAbsolute", "GroupMoveRelative"].contains(&name) {
            return self.run_whole_group(call, scene, now_s);
        }
        let object = self.group.object(call.text()?)?;
        let each = match object {
            Object::Group => 0..3,
            Object::Positioner(index) => index..index + 1,
        };
        match name {
            "GroupMoveAbsolute" | "GroupMoveRelative" => {
                let mut numbers = [None; 3];
                for index in each {
                    numbers[index] = Some(call.number()?);
                }
                call.end()?;
                let move_so = if name == "GroupMoveAbsolute" { Group::move_to } else { Group::move_by };
                move_so(&mut self.group, numbers, scene, now_s).map(Answer::from)
            }
            _ => {
                call.results(Type::Double, each.len())?;
                let count_mm = |positioner: &Positioner| positioner.count_mm(scene, now_s);
                Ok(Answer::Values(numbers(self.group.positioners[each].iter().map(count_mm))))
            }
        }
    }

    /// Runs calls of a complete group.
    fn run_whole_group(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<Answer, Code> {
        let name = call.name;
        if self.group.object(call.text()?)? != Object::Group {
            return Err(Code::WRONG_OBJECT);
        }
        if name == "GroupStatusGet" {
            let status = self.group.status().to_string();
            return tell(call, Type::Int, &status);
        }
        call.end()?;
        match name {
            "GroupKill" => {
                self.group.kill(scene, now_s);
                Ok(().into())
            }
            "GroupInitialize" => self.group.initialize(false, scene, now_s).map(Answer::from),
            "GroupInitializeWithEncoderCalibration" => self.group.initialize(true, scene, now_s).map(Answer::from),
            "GroupHomeSearch" => self.group.home_search(scene, now_s).map(Answer::from),
            "GroupMoveAbort" => self.group.abort(scene, now_s).map(Answer::from),
            "GroupMotionEnable" | "GroupMotionDisable" => {
                self.group.enable(name == "GroupMotionEnable").map(Answer::from)
            }
            _ => Err(Code::UNKNOWN_COMMAND),
        }
    }

    /// Runs calls of one positioner.
    pub(super) fn run_positioner(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<Answer, Code> {
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
        let Object::Positioner(index) = self.group.object(call.text()?)? else { return Err(Code::WRONG_OBJECT) };
        let positioner = &mut self.group.positioners[index];
        match name {
            "PositionerSGammaParametersGet" => {
                call.results(Type::Double, 4)?;
                let SGamma { speed_mm_s, acceleration_mm_s2, jerk_s } = positioner.s_gamma;
                Ok(Answer::Values(numbers([speed_mm_s, acceleration_mm_s2, jerk_s.0, jerk_s.1])))
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
                Ok(Answer::Values(numbers([positioner::SPEED_MOST_MM_S, positioner::ACCELERATION_MOST_MM_S2])))
            }
            "PositionerUserTravelLimitsGet" => {
                call.results(Type::Double, 2)?;
                Ok(Answer::Values(numbers([positioner.limits_mm.0, positioner.limits_mm.1])))
            }
            "PositionerUserTravelLimitsSet" => {
                let limits_mm = (call.number()?, call.number()?);
                call.end()?;
                self.group.limit(index, limits_mm).map(Answer::from)
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
