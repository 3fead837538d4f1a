//! Klipper behind Moonraker, request by request.
