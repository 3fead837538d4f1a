//! Result codes of calls, and their texts.

/// Result of a call: 0, or the code of an error (manual, error list).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code(pub i32);

impl Code {
    pub const DONE: Code = Code(0);
    pub const BUSY_SOCKET: Code = Code(-1);
    pub const STRING_TOO_LONG: Code = Code(-3);
    pub const UNKNOWN_COMMAND: Code = Code(-4);
    pub const WRONG_FORMAT: Code = Code(-7);
    pub const WRONG_OBJECT: Code = Code(-8);
    pub const WRONG_COUNT: Code = Code(-9);
    pub const WRONG_CHAR: Code = Code(-13);
    pub const WRONG_DOUBLE: Code = Code(-14);
    pub const WRONG_INT: Code = Code(-15);
    pub const OUT_OF_RANGE: Code = Code(-17);
    pub const POSITIONER_NAME: Code = Code(-18);
    pub const GROUP_NAME: Code = Code(-19);
    pub const NOT_ALLOWED: Code = Code(-22);
    pub const EMERGENCY: Code = Code(-26);
    pub const ABORTED: Code = Code(-27);
    pub const ACTION_NAME: Code = Code(-39);
    pub const EVENT_NAME: Code = Code(-40);
    pub const NO_EVENTS: Code = Code(-80);
    pub const NO_ACTIONS: Code = Code(-81);
    pub const TOO_MANY_EVENTS: Code = Code(-82);
    pub const EVENT_UNKNOWN: Code = Code(-83);
    pub const LOGIN: Code = Code(-106);

    /// Returns the text of `ErrorStringGet`; `None` for an unknown code.
    pub fn text(self) -> Option<&'static str> {
        TEXTS.iter().find(|(code, _)| *code == self.0).map(|(_, text)| *text)
    }
}

/// Returns the answer to `ErrorListGet`: all codes but 0, and their texts.
pub fn list() -> String {
    TEXTS.iter().skip(1).map(|(code, text)| format!("Error {code}: {text};")).collect()
}

/// Error codes of this emulator, with this program's own texts. A reply has at most 1024 bytes, and the list must fit into one
/// reply.
const TEXTS: [(i32, &str); 23] = [
    (0, "Successful command"),
    (-1, "Busy socket"),
    (-3, "String too long"),
    (-4, "Unknown command"),
    (-7, "Wrong format"),
    (-8, "Wrong object type"),
    (-9, "Wrong parameter count"),
    (-13, "char * expected"),
    (-14, "double expected"),
    (-15, "int expected"),
    (-17, "Parameter out of range"),
    (-18, "No such positioner"),
    (-19, "No such group"),
    (-22, "Not allowed action"),
    (-26, "Emergency signal"),
    (-27, "Move aborted"),
    (-39, "No such action"),
    (-40, "No such event"),
    (-80, "Events not configured"),
    (-81, "Actions not configured"),
    (-82, "Event buffer full"),
    (-83, "No such event id"),
    (-106, "Wrong user or password"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_reads_as_clients_take_it_apart_and_goes_into_a_reply() {
        let list = list();
        assert!(list.len() <= super::super::syntax::REPLY_MOST - "0,,EndOfAPI".len(), "{}", list.len());
        assert!(list.starts_with("Error -1: Busy socket;Error -3: "), "{list}");
        assert!(!list.contains(','));
        assert_eq!((Code::ABORTED.text(), Code(-6).text()), (Some("Move aborted"), None));
        assert!(TEXTS.is_sorted_by(|a, b| a.0 > b.0));
    }
}
