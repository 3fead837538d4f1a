//! Expressions of URScript: what they are worth.

use super::expression::{Call, Expression};
use crate::emulator::ur::pose::{self, Pose};
use std::fmt;

/// A value of a program. Whole numbers are numbers.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::emulator::ur) enum Value {
    Number(f64),
    Truth(bool),
    Text(String),
    List(Vec<f64>),
    Pose(Pose),
}

/// Value of a variable.
type Variables<'a> = dyn FnMut(&str) -> Option<Value> + 'a;
/// Result of a function that asks the robot.
type Asks<'a> = dyn FnMut(&str, &[Value]) -> Option<Value> + 'a;

impl Value {
    pub(in crate::emulator::ur) fn number(&self) -> Option<f64> {
        if let Value::Number(number) = self { Some(*number) } else { None }
    }

    pub(in crate::emulator::ur) fn truth(&self) -> Option<bool> {
        if let Value::Truth(truth) = self { Some(*truth) } else { None }
    }

    pub(in crate::emulator::ur) fn pose(&self) -> Option<Pose> {
        if let Value::Pose(pose) = self { Some(*pose) } else { None }
    }

    /// Numbers of a list or a pose.
    fn numbers(&self) -> Option<&[f64]> {
        match self {
            Value::List(list) => Some(list),
            Value::Pose(pose) => Some(pose),
            _ => None,
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Number(number) => write!(f, "{number}"),
            Value::Truth(true) => f.write_str("True"),
            Value::Truth(false) => f.write_str("False"),
            Value::Text(text) => f.write_str(text),
            Value::List(list) => write!(f, "{list:?}"),
            Value::Pose(pose) => write!(f, "p{pose:?}"),
        }
    }
}

impl Expression {
    /// Returns the value; `None` for what a program ends at: an unknown variable, a wrong type, an index beyond the end.
    pub(in crate::emulator::ur) fn value(&self, variables: &mut Variables<'_>, asks: &mut Asks<'_>) -> Option<Value> {
        match self {
            Expression::Constant(value) => Some(value.clone()),
            Expression::Variable(name) => variables(name),
            Expression::List(list, is_pose) => {
                let numbers: Option<Vec<f64>> = list.iter().map(|each| each.value(variables, asks)?.number()).collect();
                if *is_pose { numbers?.try_into().ok().map(Value::Pose) } else { numbers.map(Value::List) }
            }
            Expression::Element(list, index) => {
                let index = index.value(variables, asks)?.number().filter(|index| *index >= 0.0)?;
                let list = list.value(variables, asks)?;
                list.numbers()?.get(index as usize).copied().map(Value::Number)
            }
            Expression::Not(value) => value.value(variables, asks)?.truth().map(|truth| Value::Truth(!truth)),
            Expression::Negative(value) => value.value(variables, asks)?.number().map(|number| Value::Number(-number)),
            Expression::Binary(operator, both) => {
                let [left, right] = &**both;
                binary(operator, &left.value(variables, asks)?, &right.value(variables, asks)?)
            }
            Expression::Call(call) => {
                let Call { function, .. } = call;
                let arguments = call.values(variables, asks)?;
                computed(function.name, &arguments).unwrap_or_else(|| asks(function.name, &arguments))
            }
        }
    }
}

impl Call {
    /// Returns the arguments that are there, in their order. Functions with a value have no optional ones.
    pub(in crate::emulator::ur) fn values(
        &self,
        variables: &mut Variables<'_>,
        asks: &mut Asks<'_>,
    ) -> Option<Vec<Value>> {
        self.arguments.iter().flatten().map(|argument| argument.value(variables, asks)).collect()
    }
}

fn binary(operator: &str, left: &Value, right: &Value) -> Option<Value> {
    match (operator, left, right) {
        ("==", ..) => Some(Value::Truth(left == right)),
        ("!=", ..) => Some(Value::Truth(left != right)),
        ("and", Value::Truth(a), Value::Truth(b)) => Some(Value::Truth(*a && *b)),
        ("or", Value::Truth(a), Value::Truth(b)) => Some(Value::Truth(*a || *b)),
        (_, Value::Number(a), Value::Number(b)) => Some(match operator {
            "<" => Value::Truth(a < b),
            ">" => Value::Truth(a > b),
            "<=" => Value::Truth(a <= b),
            ">=" => Value::Truth(a >= b),
            "+" => Value::Number(a + b),
            "-" => Value::Number(a - b),
            "*" => Value::Number(a * b),
            "/" if *b != 0.0 => Value::Number(a / b),
            _ => return None,
        }),
        _ => None,
    }
}

/// Computes a function that needs no robot: `None` if it is another one, and an inner `None` for arguments that it doesn't take.
fn computed(name: &str, arguments: &[Value]) -> Option<Option<Value>> {
    let poses = |of: fn(Pose, Pose) -> Pose| match arguments {
        [Value::Pose(a), Value::Pose(b)] => Some(Value::Pose(of(*a, *b))),
        _ => None,
    };
    let number =
        |of: fn(f64) -> f64| arguments.first()?.number().map(of).filter(|of| of.is_finite()).map(Value::Number);
    Some(match (name, arguments) {
        ("pose_add", _) => poses(pose::add),
        ("pose_sub", _) => poses(pose::difference),
        ("pose_trans", _) => poses(pose::within),
        ("pose_inv", [Value::Pose(of)]) => Some(Value::Pose(pose::inverse(*of))),
        ("point_dist", [Value::Pose(a), Value::Pose(b)]) => Some(Value::Number(pose::distance_m(*a, *b))),
        ("norm", [Value::Number(number)]) => Some(Value::Number(number.abs())),
        ("norm", [value]) => {
            value.numbers().map(|all| Value::Number(all.iter().map(|part| part * part).sum::<f64>().sqrt()))
        }
        ("sqrt", _) => number(f64::sqrt),
        ("floor", _) => number(f64::floor),
        ("ceil", _) => number(f64::ceil),
        ("pow", [Value::Number(base), Value::Number(exponent)]) => {
            Some(base.powf(*exponent)).filter(|power| power.is_finite()).map(Value::Number)
        }
        ("to_str", [value]) => Some(Value::Text(value.to_string())),
        ("str_cat", [a, b]) => Some(Value::Text(format!("{a}{b}"))),
        ("pose_inv" | "point_dist" | "pow", _) => None,
        _ => return None,
    })
}
