"""Which data are synthetic: the records of `datasets/`, known by their checksums wherever they lie."""

SYNTHETIC = frozenset((
    "73aa42d5626d0b9d89d55be2a8f3cfb06c3050d592b79b1dd8b0f2810ba762f4",  # armor-presses.csv
    "9e62212d15c0bc1109576c384fa7822e75e7a670fcb7c18198a3422375577d4b",  # armor-wrenches.csv
    "edbecde0087e26e43cd59bbfa60cad8fdb3178b50f91f52d839116513f6eaa63",  # skin-one-place.csv
    "e237d675f514fd4202a0d7552a0fecfebd53b0bf2092aa45f3573d97e5902857",  # skin-two-places.csv
    "ca462c13db4e49025a0bf12b77082fa791af911827fb8ab0b14113fcb27eaf26",  # sponge-10mm-cycles.csv
    "56441275887d8ad2eeba79839b6c6ac13a64dba34f4a14275095d60bdbdcdaa8",  # sponge-30mm-cycles.csv
    "871c16b8fbe86f2146f38d64ce3d055ee155f8aafa0bc19c0a9f443a7da88c39",  # sponge-50mm-cycles.csv
    "d84bdb5530d7463e5616cb650759d7ba5d05c650de6ea588491ff6ec7842cc39",  # sponge-50mm-minor-loops.csv
    "41eb7741a4f666029c4b794db2a0d952f53e1baa1088695d163708fc0e00f7bf",  # sponge-50mm-mixed-cycles.csv
))  # fmt: skip
"""SHA-256 of each; `python -m benchmarks.datasets` writes the files."""


def is_synthetic(sha256: str | None) -> bool:
    """Whether a file with this checksum was made by a virtual rig of ours."""
    return sha256 in SYNTHETIC
