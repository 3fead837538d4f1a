//! Parsing of an XPS' answers.

/// Answer to a call: 0 or the error's code, and the values.
#[derive(Clone, Debug, PartialEq)]
pub struct XpsReply {
    /// 0: done; below 0: the error.
    pub code: i32,
    /// Values that the function returns, in its order.
    pub values: Vec<String>,
}

/// Parses an answer without its `EndOfAPI`: `0,v1,v2,` or `-17,CALL,`. `call` is the sent call. The text of an error repeats the
/// call word for word, so an error of another call is refused. A function that returns nothing gives one empty value.
pub fn parse_answer(text: &str, call: &str) -> Option<XpsReply> {
    let text = text.strip_suffix(',')?;
    let (code, rest) = text.split_once(',').unwrap_or((text, ""));
    let code: i32 = code.trim().parse().ok()?;
    if code != 0 {
        return (code < 0 && rest.trim() == call).then(|| XpsReply { code, values: Vec::new() });
    }
    let values: Vec<String> = if rest.is_empty() { Vec::new() } else { rest.split(',').map(str::to_owned).collect() };
    (values.len() == outputs_of(call)).then_some(XpsReply { code, values })
}

/// Number of values that a call returns: the number of its placeholders (`double *`, `int *`, `char *`).
fn outputs_of(call: &str) -> usize {
    call.matches('*').count()
}

/// Parses a finite number.
pub(super) fn number_in(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| number.is_finite())
}

/// Abilities of a group (group status list of the manual).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GroupState {
    /// Off, or killed.
    NotInitialised,
    /// On, but it isn't homed.
    NotReferenced,
    /// At rest and able to move.
    Ready,
    /// At rest with its motors off.
    Disabled,
    /// Searching for home, or initialising.
    Homing,
    /// Moving, jogging, braking.
    Moving,
}

/// Returns the state of a status number; `None` for an unknown number.
pub(super) fn group_state(status: i32) -> Option<GroupState> {
    Some(match status {
        0..=9 | 50 | 52 | 60 | 61 | 63 | 66 | 67 | 71 | 72 | 83 | 106 => GroupState::NotInitialised,
        10..=19 | 56 | 70 | 77 | 79 => GroupState::Ready,
        20..=39 | 58 | 59 | 74..=76 | 80..=82 | 84..=103 => GroupState::Disabled,
        42 => GroupState::NotReferenced,
        41 | 43 | 49 | 64 => GroupState::Homing,
        40 | 44..=48 | 51 | 55 | 65 | 68 | 69 | 73 | 78 | 104 | 105 => GroupState::Moving,
        _ => return None,
    })
}

/// Returns an error's name (error list of the manual).
pub(super) fn error_name(code: i32) -> &'static str {
    match code {
        -1 => "the socket is busy",
        -2 => "TCP time-out",
        -3 => "string too long",
        -4 => "unknown command",
        -5 => "not allowed: a positioner error, or the group isn't ready",
        -7 => "wrong format",
        -8 => "wrong object type",
        -9 => "wrong number of parameters",
        -16..=-10 => "wrong parameter type",
        -17 => "parameter out of range",
        -18 => "unknown positioner",
        -19 => "unknown group",
        -20 => "fatal error at start-up, see its log",
        -21 => "still initialising",
        -22 => "not allowed in this state",
        -25 => "following error",
        -26 => "emergency signal",
        -27 => "motion aborted",
        -28 => "home search timed out",
        -31 => "home search out of range",
        -33 => "motion-done time-out",
        -35 => "position outside the travel limits",
        -45 => "end of run reached",
        -49 => "home search: Z mark error",
        -50 => "motor initialisation failed",
        -100 => "internal error",
        -106 => "wrong login",
        -107 => "needs administrator rights",
        -108 => "socket closed by an administrator",
        -109 => "needs homing",
        _ => "see its manual",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn captured_answers_are_read() {
        let answer = |text, call| parse_answer(text, call);
        let values = |values: &[&str]| values.iter().map(|&value| value.to_owned()).collect::<Vec<_>>();
        assert_eq!(
            answer("0,XPS-DRV03;VP-25XL,", "HardwareDriverAndStageGet(1,char *)"),
            Some(XpsReply { code: 0, values: values(&["XPS-DRV03;VP-25XL"]) })
        );
        assert_eq!(answer("0,,", "GroupKill(XYZ)"), Some(XpsReply { code: 0, values: Vec::new() }));
        let call = "GroupPositionCurrentGet(Group1,double *)";
        let echo = format!("-20,{call},");
        assert_eq!(answer(&echo, call), Some(XpsReply { code: -20, values: Vec::new() }));
        assert_eq!(
            answer("-17,GroupMoveAbsolute (Axis.Pos,380),", "GroupMoveAbsolute (Axis.Pos,380)").map(|a| a.code),
            Some(-17)
        );
    }

    #[test]
    fn reply_to_another_call_is_ignored() {
        let position = "GroupPositionCurrentGet(XYZ.Z,double *)";
        for text in [
            "",
            ",",
            "0",
            "0,",
            "0,1.0",
            "0,1.0,2.0,",
            "0,,",
            "x,1.0,",
            "1,1.0,",
            "-22,GroupMoveAbsolute(XYZ.Z,1),",
            "-22,GroupPositionCurrentGet(XYZ.X,double *),",
        ] {
            let answer = parse_answer(text, position);
            // an empty value is accepted here; a reader of its number refuses it
            let number = answer.as_ref().and_then(|answer| answer.values.first()).and_then(|value| number_in(value));
            assert_eq!(number, None, "{text}: {answer:?}");
            assert!(answer.is_none_or(|answer| answer.code == 0), "{text}");
        }
    }
}
