"""Compressed forms of a dataset: fit, decode, save and load. Never imports bpy."""
