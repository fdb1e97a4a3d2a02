"""What every evaluator reads: a model resampled to direction maps and expanded to texels.

Nodes, the CPU evaluation and later the GLSL engine read these tables and only these, so that they
cannot drift apart. Never imports bpy.
"""
