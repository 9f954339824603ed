//! Who may connect: a number in all, a number an address, and a reserve for those who ask how the service is.
//!
//! A connection beyond either number is taken into the reserve: there only health, metrics and what is for admins is
//! answered, one request each, and whoever comes when it is full takes the place of the oldest. So no number of clients
//! that never send or never read keeps an operator out.

use std::collections::{HashMap, VecDeque};
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio_util::sync::CancellationToken;

/// Connections of the reserve.
const RESERVE: usize = 32;

/// How many connections there may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// In all, beside the reserve.
    pub all: usize,
    /// Of one address.
    pub per_address: usize,
}

impl ConnectionLimits {
    /// So many in all, and of one address three of four parts of them.
    pub fn of(all: usize) -> Self {
        Self { all, per_address: (all / 4 * 3).max(1) }
    }
}

/// The connections there are.
#[derive(Clone, Debug)]
pub struct Connections {
    limits: ConnectionLimits,
    now: Arc<Mutex<OpenConnections>>,
}

/// Counts the connections that are open, and holds those of the reserve.
#[derive(Debug, Default)]
struct OpenConnections {
    all: usize,
    of_address: HashMap<IpAddr, usize>,
    reserved: VecDeque<CancellationToken>,
}

/// The reason why a connection is in the reserve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReserveReason {
    /// There are as many as there may be.
    All,
    /// Its address has as many as it may have.
    Address,
}

/// A connection's place; given back on drop.
#[derive(Debug)]
pub enum ConnectionPlace {
    /// Among those that are served.
    Served(ServedPlace),
    /// In the reserve, until it is over or another takes its place.
    Reserved(CancellationToken, ReserveReason),
}

/// A place among those that are served.
#[derive(Debug)]
pub struct ServedPlace {
    now: Arc<Mutex<OpenConnections>>,
    address: IpAddr,
}

fn lock(now: &Mutex<OpenConnections>) -> MutexGuard<'_, OpenConnections> {
    now.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Connections {
    /// None yet.
    pub fn new(limits: ConnectionLimits) -> Self {
        Self { limits, now: Arc::default() }
    }

    /// A place for a connection of an address.
    pub fn place(&self, address: IpAddr) -> ConnectionPlace {
        let mut now = lock(&self.now);
        let mine = now.of_address.get(&address).copied().unwrap_or(0);
        let beyond = match () {
            () if now.all >= self.limits.all => ReserveReason::All,
            () if mine >= self.limits.per_address => ReserveReason::Address,
            () => {
                now.all += 1;
                *now.of_address.entry(address).or_default() += 1;
                return ConnectionPlace::Served(ServedPlace { now: Arc::clone(&self.now), address });
            }
        };
        now.reserved.retain(|place| !place.is_cancelled());
        if now.reserved.len() >= RESERVE
            && let Some(oldest) = now.reserved.pop_front()
        {
            oldest.cancel();
        }
        let place = CancellationToken::new();
        now.reserved.push_back(place.clone());
        ConnectionPlace::Reserved(place, beyond)
    }

    /// Connections that are served.
    pub fn len(&self) -> usize {
        lock(&self.now).all
    }

    /// Whether none is served.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl Drop for ServedPlace {
    fn drop(&mut self) {
        let mut now = lock(&self.now);
        now.all = now.all.saturating_sub(1);
        if let Some(mine) = now.of_address.get_mut(&self.address) {
            *mine = mine.saturating_sub(1);
            if *mine == 0 {
                now.of_address.remove(&self.address);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1));
    const B: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 2));

    fn is_served(place: &ConnectionPlace) -> bool {
        matches!(place, ConnectionPlace::Served(_))
    }

    #[test]
    fn an_address_has_its_share_and_places_come_back() {
        let connections = Connections::new(ConnectionLimits { all: 4, per_address: 3 });
        let mut places: Vec<ConnectionPlace> = (0..3).map(|_| connections.place(A)).collect();
        assert!(places.iter().all(is_served));
        assert!(matches!(connections.place(A), ConnectionPlace::Reserved(_, ReserveReason::Address)));
        places.push(connections.place(B));
        assert!(is_served(&places[3]));
        assert!(matches!(connections.place(B), ConnectionPlace::Reserved(_, ReserveReason::All)));
        places.remove(0);
        assert!(is_served(&connections.place(A)));
        drop(places);
        assert!(connections.is_empty());
        assert!(lock(&connections.now).of_address.is_empty());
    }

    #[test]
    fn who_comes_when_the_reserve_is_full_takes_the_place_of_the_oldest() {
        let connections = Connections::new(ConnectionLimits { all: 0, per_address: 1 });
        let places: Vec<ConnectionPlace> = (0..=RESERVE).map(|_| connections.place(A)).collect();
        let cancelled =
            |place: &ConnectionPlace| matches!(place, ConnectionPlace::Reserved(token, _) if token.is_cancelled());
        assert!(cancelled(&places[0]) && !places[1..].iter().any(cancelled));
    }
}
