//! Decks that are to be damaged.

/// A hex and a wedge with sets, as Abaqus writes them.
const PLAIN: &str = "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,0,0,1\n6,1,0,1\n7,1,1,1\n8,0,1,1\n\
9,.5,0,2\n10,.5,1,2\n*ELEMENT,TYPE=C3D8,ELSET=LOW\n1,1,2,3,4,5,6,7,8\n\
*ELEMENT,TYPE=C3D6\n2,5,6,9,8,7,10\n*ELSET,ELSET=ALL,GENERATE\n1,2,1\n*ELSET,ELSET=BOTH\nLOW,2\n";
/// Nodes and elements made of others, in systems of their own.
const GENERATED: &str = "*SYSTEM\n5,0,0, 5,1,0\n4,0,0\n*NODE, SYSTEM=C, NSET=ENDS\n1,1,0,0\n5,1,90,0\n101,2,0,0\n\
105,2,90,0\n999,0,0,0\n*SYSTEM\n*NGEN, LINE=C, NSET=LOW\n1,5,1,999\n101,105,1,999,,,,0,0,1\n*NGEN\n5,105,50\n\
*NSET, NSET=A\n1,2,3\n*NSET, NSET=B, GENERATE\n101,103,1\n*NFILL, BIAS=0.8\nA,B,2,30\n\
*NCOPY, CHANGE NUMBER=200, OLD SET=LOW, SHIFT, NEW SET=TOP\n0,0,1\n0,0,0, 0,0,1, 0\n\
*ELEMENT, TYPE=C3D8, ELSET=FIRST\n1,1,101,102,2,201,301,302,202\n*ELGEN, ELSET=ALL\n1,4,1,1\n\
*NCOPY, CHANGE NUMBER=1000, OLD SET=LOW, REFLECT=MIRROR\n9,0,0, 9,1,0\n9,0,1\n\
*NCOPY, CHANGE NUMBER=1000, OLD SET=TOP, REFLECT=MIRROR\n9,0,0, 9,1,0\n9,0,1\n\
*ELCOPY, OLD SET=ALL, ELEMENT SHIFT=10, SHIFT NODES=1000, NEW SET=FAR\n*ELSET, ELSET=\"every one\"\nALL, far\n";
/// Parts and instances.
const ASSEMBLY: &str = "*PART, NAME=P\n*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,0,0,1\n6,1,0,1\n7,1,1,1\n8,0,1,1\n\
*ELEMENT, TYPE=SC8R, ELSET=E\n1,1,2,3,4,\n5,6,7,8\n*ELEMENT, TYPE=SPRINGA\n2,1,2\n*END PART\n*ASSEMBLY, NAME=A\n\
*INSTANCE, NAME=P-1, PART=P\n*END INSTANCE\n*INSTANCE, NAME=P-2, PART=P\n10.,0.,0.\n10.,0.,0., 10.,0.,1., -90.\n\
*NODE\n9,.5,.5,3\n*ELEMENT, TYPE=C3D5\n3,5,6,7,8,9\n*END INSTANCE\n*ELSET, ELSET=S, INSTANCE=P-2\n1,3\n\
*ELSET, ELSET=ALL\nS, P-1.E, P-2.1\n*END ASSEMBLY\n*MATERIAL, NAME=M\n*STEP\n*END STEP\n";

pub fn seeds() -> Vec<Vec<u8>> {
    [PLAIN, GENERATED, ASSEMBLY]
        .map(|d| d.as_bytes().to_vec())
        .to_vec()
}
