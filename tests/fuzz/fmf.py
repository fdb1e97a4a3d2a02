"""Files of the full matrix factorisation."""

from bonn_files import FmfFile

READER = "btf"
SUFFIX = ".btf"


def seeds() -> dict[str, bytes]:
    return {
        "usual": FmfFile(width=3, height=3, version=4).to_bytes(),
        "half": FmfFile(fmf_version=1, logarithms=1, scalar=2).to_bytes(),
        "transposed": FmfFile(transposed=True, scalar=8, height_map=(2, 3), most=2).to_bytes(),
        "old": FmfFile(signature=b"!FMF06FC", version=1).to_bytes(),
        "spectral": FmfFile(
            version=4, channel_names=(b"400", b"500", b"700 nm"), width=2
        ).to_bytes(),
        "bgr": FmfFile(version=4, channel_names=(b"B", b"G", b"R"), cosine_flag=0).to_bytes(),
    }
