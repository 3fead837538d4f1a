//! The robot, port by port.
