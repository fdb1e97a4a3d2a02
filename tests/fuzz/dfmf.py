"""Files of the decorrelated full matrix factorisation."""

from tests.datasets.btf_writer import BtfFile

READER = "btf"
SUFFIX = ".btf"


def seeds() -> dict[str, bytes]:
    return {
        "usual": BtfFile(width=3, height=3).to_bytes(),
        "half": BtfFile(version=4, colour_model=11, scalars=(2, 2, 2), width=2).to_bytes(),
        "transposed": BtfFile(
            version=3, xml=b"", transposed=True, colour_model=12, scalars=(8, 4, 2)
        ).to_bytes(),
        "old": BtfFile(signature=b"!DFMF08FC", version=1, colour_model=9).to_bytes(),
    }
