//! Requests for a motion under way.

use std::cell::Cell;
use tokio::sync::Notify;

/// Requests for a motion under way, from the code that watches the force meanwhile.
#[derive(Debug, Default)]
pub struct MotionOrders {
    pulled: Notify,
    order: Cell<Option<MotionOrder>>,
    stopped: Cell<bool>,
    /// By how much longer the motion takes, as a share of its time.
    slowed: Cell<f64>,
}

/// One request for a motion under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionOrder {
    /// Stop the motion.
    Stop,
    /// Continue toward the same target at this speed, mm/s.
    Speed(f64),
}

impl MotionOrders {
    /// Requests a stop. Later requests can't cancel it.
    pub fn stop(&self) {
        if !self.stopped.replace(true) {
            self.order.set(Some(MotionOrder::Stop));
            self.pulled.notify_one();
        }
    }

    /// Requests another speed, mm/s.
    pub fn speed(&self, mm_s: f64) {
        if !self.stopped.get() {
            self.order.set(Some(MotionOrder::Speed(mm_s)));
            self.pulled.notify_one();
        }
    }

    /// Reports that the stage moves at this share of the ordered speed: an arm has a speed slider.
    pub fn slow(&self, pace: f64) {
        self.slowed.set(self.slowed.get().max(1.0 / pace - 1.0));
    }

    /// Returns the factor by which the motion takes longer, at most.
    pub fn slowness(&self) -> f64 {
        1.0 + self.slowed.get()
    }

    /// Whether a stop was requested.
    pub fn stopped(&self) -> bool {
        self.stopped.get()
    }

    /// Notified when something is requested.
    pub fn pulled(&self) -> &Notify {
        &self.pulled
    }

    /// Returns the last request that hasn't been taken yet.
    pub fn take(&self) -> Option<MotionOrder> {
        self.order.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stop_is_final_and_only_the_last_speed_counts() {
        let orders = MotionOrders::default();
        orders.speed(2.0);
        orders.speed(1.0);
        assert_eq!((orders.take(), orders.take()), (Some(MotionOrder::Speed(1.0)), None));
        orders.speed(0.5);
        orders.stop();
        orders.speed(3.0);
        assert_eq!((orders.take(), orders.stopped()), (Some(MotionOrder::Stop), true));
        orders.stop();
        assert_eq!(orders.take(), None);
    }
}
