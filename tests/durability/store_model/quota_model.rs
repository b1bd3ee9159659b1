//! The model of quotas.

use super::model::Model;

#[derive(Debug, Clone, Copy, Default)]
pub struct Quota {
    pub granted: Option<i64>,
    pub reserved: i64,
    pub charged: i64,
    pub used_before: i64,
}

impl Model {
    /// Reserves a unit of an owner's quota, if there is one.
    pub fn reserve(&mut self, owner: Option<&str>) -> bool {
        let Some(owner) = owner else { return true };
        let quota = self.quotas.entry(owner.to_owned()).or_default();
        let used = quota.charged + quota.reserved - quota.used_before;
        let is_left = quota.granted.is_none_or(|granted| granted > used);
        quota.reserved += i64::from(is_left);
        is_left
    }

    /// Charges a reserved unit, or gives it back.
    pub fn settle_unit(&mut self, owner: Option<&str>, is_charged: bool) {
        let Some(quota) = owner.and_then(|owner| self.quotas.get_mut(owner)) else { return };
        quota.reserved -= 1;
        if is_charged {
            quota.charged += 1;
        } else {
            quota.used_before = quota.used_before.min(quota.charged + quota.reserved);
        }
    }

    pub fn grant(&mut self, owner: &str, units: i64) {
        let quota = self.quotas.entry(owner.to_owned()).or_default();
        if quota.granted.is_none() {
            quota.used_before = quota.charged + quota.reserved;
        }
        quota.granted = Some(quota.granted.unwrap_or(0) + units);
    }

    pub fn lift(&mut self, owner: &str) -> bool {
        let quota = self.quotas.entry(owner.to_owned()).or_default();
        let was_limited = quota.granted.take().is_some();
        if was_limited {
            quota.used_before = 0;
        }
        was_limited
    }
}
