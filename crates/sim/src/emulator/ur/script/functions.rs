//! Functions of URScript that are known here (document: "URScript manual"). A program that names another one isn't compiled.

/// A function.
#[derive(Debug, PartialEq)]
pub(in crate::emulator::ur) struct Function {
    pub name: &'static str,
    pub parameters: &'static [&'static str],
    /// Number of parameters, from the first one, that must be given.
    pub required: usize,
}

impl Function {
    /// Returns the function with a name.
    pub(super) fn named(name: &str) -> Option<&'static Function> {
        FUNCTIONS.iter().find(|function| function.name == name)
    }
}

const fn function(name: &'static str, parameters: &'static [&'static str], required: usize) -> Function {
    Function { name, parameters, required }
}

static FUNCTIONS: [Function; 32] = [
    // they act, and have no value
    function("movel", &["pose", "a", "v", "t", "r"], 1),
    function("stopl", &["a", "aRot"], 1),
    function("sleep", &["t"], 1),
    function("sync", &[], 0),
    function("halt", &[], 0),
    function("set_tcp", &["pose", "tcp_name"], 1),
    function("set_payload", &["m", "cog"], 1),
    function("write_output_integer_register", &["address", "value"], 2),
    function("write_output_float_register", &["address", "value"], 2),
    function("textmsg", &["s1", "s2"], 1),
    function("popup", &["s", "title", "warning", "error", "blocking"], 1),
    // they ask the robot
    function("get_actual_tcp_pose", &[], 0),
    function("get_target_tcp_pose", &[], 0),
    function("get_tcp_offset", &[], 0),
    function("get_target_payload", &[], 0),
    function("is_steady", &[], 0),
    function("is_within_safety_limits", &["pose"], 1),
    function("read_output_integer_register", &["address"], 1),
    function("read_output_float_register", &["address"], 1),
    // they compute
    function("pose_add", &["p_1", "p_2"], 2),
    function("pose_sub", &["p_to", "p_from"], 2),
    function("pose_trans", &["p_from", "p_from_to"], 2),
    function("pose_inv", &["p_from"], 1),
    function("point_dist", &["p_from", "p_to"], 2),
    function("norm", &["a"], 1),
    function("sqrt", &["f"], 1),
    function("pow", &["base", "exponent"], 2),
    function("floor", &["f"], 1),
    function("ceil", &["f"], 1),
    function("to_str", &["val"], 1),
    function("str_cat", &["op1", "op2"], 2),
    function("get_steptime", &[], 0),
];
