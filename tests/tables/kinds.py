"""Models of each method, small: what make_model is given."""

SHAPE = (12, 14, 5, 6, 3)
KINDS = {
    "nsvd": {"ranks": (5, 6, 3, 3)},
    "nsvd of whole quads": {"ranks": (8, 4, 3, 3)},
    "cta": {"ranks": (3, 2, 3, 3), "clusters": {"view": 3}, "shared": ("light",)},
    "kcta": {
        "ranks": (6, 3, 2, 3),
        "clusters": {"view": 4},
        "mixtures": {"view": 2},
        "shared": ("light",),
    },
    "kcta of global bases": {
        "ranks": (4, 5, 2, 3),
        "clusters": {"view": 3},
        "mixtures": {"view": 2},
        "shared": ("light", "y", "x"),
    },
    "kcta of local lights": {
        "ranks": (5, 3, 2, 3),
        "clusters": {"view": 4},
        "mixtures": {"view": 2},
        "shared": (),
    },
    "kcta of lights": {
        "ranks": (3, 6, 2, 3),
        "clusters": {"light": 3},
        "mixtures": {"light": 2},
        "shared": (),
    },
    "mkcta": {
        "ranks": (3, 5, 3, 3),
        "clusters": {"light": 4, "view": 3},
        "mixtures": {"light": 3, "view": 2},
        "shared": ("y", "x"),
    },
}
