//! What is kept of a machine, and when it is measured again.

use std::fs;

use super::*;

/// This machine with rates that none has.
fn marked() -> Machine {
    Machine {
        one: Rates { bandwidth: 1.0, arithmetic: 2.0 },
        all: Rates { bandwidth: 3.0, arithmetic: 10.0 },
        factorisation: 7.5,
        ..Machine::unmeasured()
    }
}

#[test]
fn what_is_measured_makes_sense() {
    let machine = Machine::measured();
    assert!(machine.is_sound() && machine.factorisation > 1e6, "{machine:?}");
    assert!(machine.lanes.is_power_of_two() && !machine.processor.is_empty(), "{machine:?}");
    // No machine is that slow or fast.
    for rates in [machine.one, machine.all] {
        assert!((1e6..1e14).contains(&rates.bandwidth), "{machine:?}");
        assert!((1e6..1e16).contains(&rates.arithmetic), "{machine:?}");
    }
}

#[test]
fn a_file_that_fits_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("some/where/machine.json");
    assert_eq!(Machine::read(&file), None);
    marked().keep_in(&file).unwrap();
    assert_eq!(Machine::kept_in(Some(&file)), marked());
    let beside = fs::read_dir(file.parent().unwrap()).unwrap().count();
    assert_eq!(beside, 1, "no temporary file is left");
}

#[test]
fn a_stale_or_broken_file_is_measured_again() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("machine.json");
    let stale = [
        Machine { version: "0.0.0".into(), ..marked() },
        Machine { processor: "abacus".into(), ..marked() },
        Machine { lanes: 3, ..marked() },
        Machine { threads: marked().threads + 1, ..marked() },
        Machine { one: Rates::NONE, ..marked() },
        Machine { factorisation: 0.0, ..marked() },
        Machine { all: Rates { bandwidth: -1.0, ..marked().all }, ..marked() },
    ];
    for machine in stale {
        machine.keep_in(&file).unwrap();
        assert_eq!(Machine::read(&file), None, "{machine:?}");
    }
    let whole = serde_json::to_string(&marked()).unwrap();
    let no_number = whole.replace("10.0", "null");
    assert_ne!(no_number, whole);
    for text in ["", "{}", "[1, 2", "\u{0}\u{ff}", &whole[..whole.len() / 2], &no_number] {
        fs::write(&file, text).unwrap();
        assert_eq!(Machine::read(&file), None, "{text}");
    }
    let measured = Machine::kept_in(Some(&file));
    let read = Machine::read(&file).unwrap();
    // The reader of JSON may be off by a unit in the last place.
    let rates = |m: &Machine| {
        let [one, all] = [m.one, m.all].map(|rates| [rates.bandwidth, rates.arithmetic]);
        [one[0], one[1], all[0], all[1], m.factorisation]
    };
    let pairs = rates(&read).into_iter().zip(rates(&measured));
    assert!(pairs.into_iter().all(|(x, y)| (x / y - 1.0).abs() < 1e-15), "{read:?} {measured:?}");
    let same =
        Machine { one: read.one, all: read.all, factorisation: read.factorisation, ..measured };
    assert_eq!(read, same);
}

#[test]
fn a_place_where_nothing_can_be_written_is_no_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a file");
    fs::write(&file, "of another kind").unwrap();
    // A folder that is a file, and a file that is a folder.
    let beyond = file.join("machine.json");
    assert!(marked().keep_in(&beyond).is_err() && marked().keep_in(folder.path()).is_err());
    assert!(Machine::kept_in(Some(&beyond)).is_sound());
    assert_eq!(fs::read_to_string(&file).unwrap(), "of another kind");
}

#[test]
fn threads_between_one_and_all_share_what_they_add() {
    let five = Machine { threads: 5, ..marked() };
    let arithmetic = |threads| five.rates(threads).arithmetic;
    assert_eq!([0, 1, 2, 3, 5, 9].map(arithmetic), [2.0, 2.0, 4.0, 6.0, 10.0, 10.0]);
    assert_eq!(five.rates(3).bandwidth, 2.0);
    let alone = Machine { threads: 1, all: marked().one, ..marked() };
    assert_eq!((alone.rates(1), alone.rates(4)), (alone.one, alone.one));
}
