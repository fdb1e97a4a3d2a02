"""Virtual instruments: Cycles renders of a patch in the scene become datasets."""
