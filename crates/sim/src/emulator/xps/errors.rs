//! Result codes of calls, and their texts.

/// Result of a call: 0, or the code of an error (manual, error list).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Code(pub i32);

impl Code {
    pub(super) const DONE: Code = Code(0);
    pub(super) const BUSY_SOCKET: Code = Code(-1);
    pub(super) const STRING_TOO_LONG: Code = Code(-3);
    pub(super) const UNKNOWN_COMMAND: Code = Code(-4);
    pub(super) const WRONG_FORMAT: Code = Code(-7);
    pub(super) const WRONG_OBJECT: Code = Code(-8);
    pub(super) const WRONG_COUNT: Code = Code(-9);
    pub(super) const WRONG_CHAR: Code = Code(-13);
    pub(super) const WRONG_DOUBLE: Code = Code(-14);
    pub(super) const WRONG_INT: Code = Code(-15);
    pub(super) const OUT_OF_RANGE: Code = Code(-17);
    pub(super) const POSITIONER_NAME: Code = Code(-18);
    pub(super) const GROUP_NAME: Code = Code(-19);
    pub(super) const NOT_ALLOWED: Code = Code(-22);
    pub(super) const EMERGENCY: Code = Code(-26);
    pub(super) const ABORTED: Code = Code(-27);
    pub(super) const ACTION_NAME: Code = Code(-39);
    pub(super) const EVENT_NAME: Code = Code(-40);
    pub(super) const NO_EVENTS: Code = Code(-80);
    pub(super) const NO_ACTIONS: Code = Code(-81);
    pub(super) const TOO_MANY_EVENTS: Code = Code(-82);
    pub(super) const EVENT_UNKNOWN: Code = Code(-83);
    pub(super) const LOGIN: Code = Code(-106);

    /// Returns the text of `ErrorStringGet`; `None` for an unknown code.
    pub(super) fn text(self) -> Option<&'static str> {
        TEXTS.iter().find(|(code, _)| *code == self.0).map(|(_, text)| *text)
    }
}

/// Returns the answer to `ErrorListGet`: all codes but 0, and their texts.
pub(super) fn list() -> String {
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
    fn error_list_has_the_format_that_clients_parse() {
        let list = list();
        assert!(list.len() <= super::super::syntax::REPLY_MOST - "0,,EndOfAPI".len(), "{}", list.len());
        assert!(list.starts_with("Error -1: Busy socket;Error -3: "), "{list}");
        assert!(!list.contains(','));
        assert_eq!((Code::ABORTED.text(), Code(-6).text()), (Some("Move aborted"), None));
        assert!(TEXTS.is_sorted_by(|a, b| a.0 > b.0));
    }
}
