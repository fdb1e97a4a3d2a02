"""Sets of images: files in archives, decoding, values, angles in names, grids of directions.

The readers of such sets are beside this folder, one file each.
"""
