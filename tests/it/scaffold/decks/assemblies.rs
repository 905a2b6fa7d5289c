//! Parts and instances.

use super::{CUBE, assert_box, assert_near, group, names, read, refusal, solids, stored, volume};
use druse::io::Place;

#[test]
fn instances_are_moved_then_turned() {
    let file = solids(stored("two_instances.inp"));
    assert_eq!(file.scaffold.len(), 2);
    assert_near(volume(&file), 2000.0);
    assert_box(&file, [0.0, -10.0, 0.0], [20.0, 10.0, 10.0]);
    assert_eq!(group(&file, "solid"), Some(vec![0, 1]));
    assert_eq!(
        (group(&file, "P-1"), group(&file, "P-2")),
        (Some(vec![0]), Some(vec![1]))
    );
    // The second has the number 5 too.
    assert_eq!([0, 1].map(|e| file.scaffold.number(e)), [5, 15]);
    assert!(file.notes[1].contains("P-2"), "{:?}", file.notes);
}

fn deck() -> String {
    format!(
        "*HEADING\n*PART, NAME=\"Big block\"\n*SYSTEM\n0,0,5\n*NODE\n{CUBE}\
         *ELEMENT, TYPE=C3D8, ELSET=Core\n1,1,2,3,4,5,6,7,8\n*ELSET, ELSET=set-1\n1\n*END PART\n\
         *PART, NAME=pin\n*NODE\n{CUBE}*ELEMENT, TYPE=C3D6, ELSET=CORE\n1,1,2,3,5,6,7\n2,1,3,4,5,7,8\n\
         *ELSET, ELSET=half\n2\n*END PART\n*PART, NAME=ghost\n*NODE\n1,0,0,0\n*ENDPART\n\
         *ASSEMBLY, NAME=A\n*INSTANCE, NAME=B-1, PART=\"BIG BLOCK\"\n*END INSTANCE\n\
         *INSTANCE, NAME=Pin-1, PART=PIN\n10,\n*END INSTANCE\n\
         *INSTANCE, NAME=Pin-2, PART=Pin\n0.,20.,0.,\n0,0,0, 0,0,2, 90\n\
         *NODE\n20,0,0,3\n*ELEMENT, TYPE=C3D4, ELSET=TIP\n9,5,6,8,20\n*END INSTANCE\n\
         *NODE, NSET=RP\n1,7,7,7\n*ELEMENT, TYPE=MASS\n1,1\n*NSET, NSET=N, INSTANCE=PIN-1\n1,2\n\
         *ELSET, ELSET=chosen, INSTANCE=pin-2, GENERATE\n1,2\n*ELSET, ELSET=CHOSEN, INSTANCE=B-1\n1\n\
         *ELSET, ELSET=all\nchosen, Pin-1.core, Pin-2.9\n*ELSET, ELSET=Set-1, INSTANCE=Pin-1\nhalf\n\
         *SURFACE, NAME=S\nchosen, S1\n*END ASSEMBLY\n*MATERIAL, NAME=M\n*STEP\n*END STEP\n"
    )
}

#[test]
fn parts_have_numbers_and_sets_of_their_own() {
    let file = solids(read(&deck()));
    // B-1: 0; Pin-1: 1, 2; Pin-2: 3, 4 and its own tetrahedron, 5.
    assert_eq!(file.scaffold.len(), 6);
    // The tetrahedron on the top of the turned pin, 2 above it.
    assert_near(volume(&file), 1.0 + 1.0 + 1.0 + 1.0 / 3.0);
    assert_box(&file, [-21.0, 0.0, 0.0], [11.0, 1.0, 6.0]);
    for (name, elements) in [
        ("Core", vec![0, 1, 2, 3, 4]),
        ("B-1.Core", vec![0]),
        ("Pin-1.Core", vec![1, 2]),
        ("Pin-2.Core", vec![3, 4]),
        ("TIP", vec![5]),
        ("half", vec![2, 4]),
        ("chosen", vec![0, 3, 4]),
        ("all", vec![0, 1, 2, 3, 4, 5]),
        // The assembly's set of this name, and that of a part.
        ("Set-1", vec![2]),
        ("B-1.set-1", vec![0]),
        ("Pin-2", vec![3, 4, 5]),
    ] {
        assert_eq!(
            group(&file, name),
            Some(elements),
            "{name}: {:?}",
            names(&file)
        );
    }
    assert!(
        file.notes.iter().any(|n| n.contains("1 MASS")),
        "{:?}",
        file.notes
    );
    assert!(
        file.warnings.iter().any(|n| n.contains("ghost")),
        "{:?}",
        file.warnings
    );
    assert_eq!([0, 1, 5].map(|e| file.scaffold.number(e)), [1, 11, 29]);
}

#[test]
fn what_parts_lack_is_refused() {
    let with = |from: &str, to: &str| {
        let deck = deck();
        assert!(deck.contains(from), "{from}");
        refusal(&deck.replace(from, to))
    };
    let e = with("PART=Pin\n", "PART=Bin\n");
    assert!(e.found().contains("BIN"), "{e}");
    let e = with("NAME=Pin-2,", "NAME=PIN-1,");
    assert!(e.found().contains("second instance"), "{e}");
    let e = with("INSTANCE=pin-2", "INSTANCE=pin-9");
    assert!(e.found().contains("pin-9"), "{e}");
    let e = with("9,5,6,8,20", "9,5,6,8,21");
    assert_eq!(e.place(), Place::Item("element", 9));
    let e = with("0,0,2, 90", "0,0,0, 90");
    assert!(e.expected().contains("axis"), "{e}");
    let e = with("Pin-1.core", "Pin-1.score");
    assert!(e.found().contains("score"), "{e}");
    let e = with("PART=PIN\n", "PART=PIN, LIBRARY=old\n");
    assert!(e.found().contains("LIBRARY"), "{e}");
    let e = with("NAME=ghost", "NAME=PIN");
    assert!(e.found().contains("second part"), "{e}");
}

#[test]
fn a_deck_of_one_part_reads_with_and_without_instance() {
    let part = format!(
        "*PART, NAME=P\n*NODE\n{CUBE}*ELEMENT, TYPE=C3D8, ELSET=E\n4,1,2,3,4,5,6,7,8\n*END PART\n"
    );
    let instance = "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=P-1, PART=P\n*END INSTANCE\n*END ASSEMBLY\n";
    for text in [part.clone(), part.clone() + instance] {
        let file = solids(read(&text));
        assert_near(volume(&file), 1.0);
        assert_eq!(file.scaffold.number(0), 4);
        assert_eq!(names(&file), ["E"]);
        assert!(file.notes.is_empty() && file.warnings.is_empty());
    }
    let text = part.replace("4,1,2,3,4,5,6,7,8", "4,1,2,3,4,5,6,7,88") + instance;
    let e = refusal(&text);
    assert!(e.found().contains("node 88"), "{e}");
}
