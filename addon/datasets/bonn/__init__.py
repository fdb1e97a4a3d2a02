"""The University of Bonn's family of `.btf` files, one file for each layout.

All begin with a signature, a header and the lists of directions. What follows is one of

    DFMF  a factorised matrix for each channel of a decorrelated colour space (`dfmf`)
    FMF   one factorised matrix for all channels (`fmf`)
    PVF   one factorised matrix for each view (`pvf`)
    BDI   all reflectance as half floats, texel by texel (`bdi`)

The definition is Bonn's reader and writer btflib (University of Bonn, 2014-2016);
`docs/formats.md` says where other readers differ. All numbers are little-endian;
texel = y * width + x, row 0 at the bottom.
"""
