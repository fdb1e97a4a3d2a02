"""Measured appearance with named axes: the dataset folder, and one reader for each file format.

Nothing here imports `bpy`; plain Python with numpy (and Pillow, for formats made of images) is
enough.
"""
