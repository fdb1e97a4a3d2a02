"""Files of the per-view factorisation."""

from bonn_files import PvfFile

READER = "btf"
SUFFIX = ".btf"


def seeds() -> dict[str, bytes]:
    return {
        "usual": PvfFile(width=3, height=3, version=4).to_bytes(),
        "half": PvfFile(signature=b"!PVF06FC", scalar=2, cosine_flag=0).to_bytes(),
        "transposed": PvfFile(transposed=True, scalar=8, width=2).to_bytes(),
        "oldest": PvfFile(oldest=True).to_bytes(),
        "spectral": PvfFile(
            version=4, channel_names=(b"400", b"500", b"700 nm"), width=2
        ).to_bytes(),
        "bgr": PvfFile(version=4, channel_names=(b"B", b"G", b"R"), cosine_flag=0).to_bytes(),
    }
