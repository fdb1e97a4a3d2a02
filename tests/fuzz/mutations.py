"""Damages files at random, the same way for the same seed: what runs where atheris is not."""

import random
from collections.abc import Iterator, Sequence

# Sizes and counts are 32 bits wide in most formats: what breaks sums and products of them.
_NUMBERS = [0, 1, 2, 3, 4, 7, 8, 16, 255, 256, 65535, 2**24, 2**31 - 1, 2**31, 2**32 - 2, 2**32 - 1]
# Headers are short, samples long: half of all changes are made here.
_HEADER = 600


def damaged(files: Sequence[bytes], count: int, seed: int) -> Iterator[bytes]:
    """`count` files, each one of `files` with one to five random changes."""
    chance = random.Random(seed)
    for _ in range(count):
        data = bytearray(chance.choice(files))
        for _ in range(chance.randint(1, 5)):
            if data:
                _change(data, files, chance)
        yield bytes(data)


def _change(data: bytearray, files: Sequence[bytes], chance: random.Random) -> None:
    reach = len(data) if chance.random() < 0.5 else min(len(data), _HEADER)
    at = chance.randrange(reach)
    length = chance.choice([1, 2, 4, 8, 12, chance.randrange(1, 64)])
    match chance.randrange(8):
        case 0:
            data[at] ^= 1 << chance.randrange(8)
        case 1:
            data[at] = chance.choice([0, 1, 127, 128, 255, chance.randrange(256)])
        case 2 | 3:
            data[at : at + 4] = chance.choice(_NUMBERS).to_bytes(4, "little")
        case 4:
            del data[at : at + length]
        case 5:
            data[at:at] = data[at : at + length] * chance.choice([1, 1, 2, 8])
        case 6:
            del data[at:]
        case 7:
            other = chance.choice(files)
            start = chance.randrange(len(other) + 1)
            data[at : at + length] = other[start : start + length]
