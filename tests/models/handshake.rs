//! A box and a program on a network that does anything: every order in which packets are lost, come
//! late, come again or out of their order, in which time passes and either side restarts, up to a number
//! of steps; from the very beginning, and from a session that has begun.
//!
//! - No packet is taken twice, however often it comes; nothing is taken that was not said.
//! - A packet that was changed on its way, or thrown back, changes nothing.
//! - Wherever that leads: once packets come through again, the program is heard, and hears.
//!
//! The real ends are tried, not a model of them. They cannot be copied, so that each is brought to a
//! state by the steps that lead there; states in which all is the same but the time of day count as one.

mod world;

use std::collections::{BTreeMap, HashSet};

use plumbline_test_support::evidence;
use rayon::prelude::*;

use world::{Base, Event, World};

/// How many states and steps were tried.
#[derive(Debug, Default, Clone, Copy)]
struct Tried {
    states: usize,
    steps: u64,
}

/// A state, and what has led there.
type Successor = ([u8; 32], Event);

/// Tries everything that can happen within so many steps. Each state is reached by a shortest way.
fn explore(base: Base, depth: usize) -> Tried {
    let mut known: HashSet<[u8; 32]> = HashSet::from([World::after(base, &[]).state()]);
    let mut ways = vec![Vec::new()];
    let mut tried = Tried { states: 1, steps: 0 };
    for _ in 0..depth {
        let found: Vec<(Vec<Event>, Vec<Successor>)> =
            ways.par_iter().map(|way| (way.clone(), successors(base, way))).collect();
        // In the order of their ways, so that it is the same in every run.
        let mut next: BTreeMap<[u8; 32], Vec<Event>> = BTreeMap::new();
        for (way, successors) in found {
            for (state, event) in successors {
                tried.steps += 1;
                if known.insert(state) {
                    next.insert(state, [&way[..], &[event]].concat());
                }
            }
        }
        ways = next.into_values().collect();
        tried.states += ways.len();
        ways.par_iter().for_each(|way| {
            let mut world = World::after(base, way);
            world.assert_forgeries_are_worthless();
            world.honest();
        });
    }
    tried
}

/// What each thing that can happen leads to.
fn successors(base: Base, way: &[Event]) -> Vec<Successor> {
    let mut world = World::after(base, way);
    let before = world.state();
    let mut successors = Vec::new();
    for event in world.possible() {
        world.happens(event);
        let state = world.state();
        successors.push((state, event));
        // What has changed nothing needs no way back.
        if state != before {
            world = World::after(base, way);
        }
    }
    successors
}

fn handshakes(from_greeting: usize, from_session: usize) {
    for (base, depth, name) in [
        (Base::Greeting, from_greeting, "a program's first greeting"),
        (Base::Session, from_session, "a session"),
    ] {
        let Tried { states, steps } = explore(base, depth);
        evidence(
            &format!(
                "the link of a box and a program, after {name}: every order of loss, delay, repetition, \
                 replay, pauses and restarts of either side, up to {depth} steps"
            ),
            &format!("{states} states, {steps} steps"),
            "no packet was taken twice, none that was changed or thrown back; from each state both are \
             heard again once packets come through",
        );
    }
}

#[test]
fn a_session_holds_in_every_short_history() {
    handshakes(5, 3);
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_session_holds_in_every_history() {
    handshakes(7, 4);
}
