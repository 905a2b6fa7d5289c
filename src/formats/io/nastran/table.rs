//! Tables of cards that are skipped, refused or ignored. Cards in none of them that begin with C are refused, since
//! they may make elements; all others are ignored.

/// Bars, springs, masses, rigid links, heat and fluid boundaries: no volume and no surface.
pub(super) const SKIPPED_CARDS: &[&str] = &[
    "CAABSF", "CACINF3", "CACINF4", "CBAR", "CBEAM", "CBEAM3", "CBEND", "CBUSH", "CBUSH1D",
    "CBUSH2D", "CDAMP1", "CDAMP1D", "CDAMP2", "CDAMP2D", "CDAMP3", "CDAMP4", "CDAMP5", "CELAS1",
    "CELAS1D", "CELAS2", "CELAS2D", "CELAS3", "CELAS4", "CFAST", "CFLUID2", "CFLUID3", "CFLUID4",
    "CGAP", "CHACAB", "CHACBR", "CHBDY", "CHBDYE", "CHBDYG", "CHBDYP", "CMASS1", "CMASS2",
    "CMASS3", "CMASS4", "CONM1", "CONM2", "CONROD", "CRAC2D", "CRAC3D", "CROD", "CSEAM", "CSLOT3",
    "CSLOT4", "CTUBE", "CVISC", "CWELD", "CWSEAM", "PLOTEL", "PLOTEL3", "PLOTEL4", "PLOTEL6",
    "PLOTEL8", "RBAR", "RBAR1", "RBE1", "RBE2", "RBE2GS", "RBE3", "RJOINT", "RROD", "RSPLINE",
    "RSSCON", "RTRPLT", "RTRPLT1",
];

/// Cards that make or move points and elements in unsupported ways.
pub(super) const REFUSED_CARDS: &[&str] = &[
    "CGEN", "CSUPER", "CSUPEXT", "DELETE", "EGRID", "EQUIV", "FEEDGE", "FEFACE", "GMBNDC",
    "GMBNDS", "GMCURV", "GMSURF", "GRIDB", "GRIDD", "GRIDF", "GRIDG", "GRIDMOD", "GRIDS", "GRIDU",
    "GMCORD", "RINGAX", "RINGFL", "SECTAX", "SEBULK", "SELOC", "SEMPLN", "MGRID", "MLINE", "MAREA",
    "MPOINT",
];

/// Cards that begin with C and make no elements; a `*` stands for the rest of a name.
pub(super) const NON_ELEMENT_CARDS: &[&str] = &[
    "CAERO*", "CAMPBLL", "CASECC", "CBARAO", "CCRSFIL", "CDDATA", "CEND", "CFAILURE", "CHKFAIL",
    "CLAMP*", "CLOAD", "CLOADEX", "CLUSTER", "CMREBAI", "CNTNODE", "CNTRGRP", "COHESIV", "COHFRIC",
    "COMBWLD", "CONCTL", "CONTACT", "CONTOUR", "CONTRLT", "CONV", "CONV3", "CONVM", "COUP*",
    "CREEP", "CRADMAT", "CROSSE", "CRYSL", "CSCHD", "CSET", "CSET1", "CSSCHD", "CSPR", "CSYM*",
    "CYAX", "CYJOIN", "CYSUP", "CYSYM",
];
