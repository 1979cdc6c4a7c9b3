"""Which data are synthetic: the records of `datasets/`, known by their checksums wherever they lie."""

SYNTHETIC = frozenset((
    "dbb5ae2b7b1ba787b0b38db6b5e57f50d141206c4ce154fe4f0efcdbab650af2",  # armor-presses.csv
    "a1cee6ae82ff69a5d14ade44d9cf606083fd47daa44fb08a96289be0740829e8",  # armor-wrenches.csv
    "edbecde0087e26e43cd59bbfa60cad8fdb3178b50f91f52d839116513f6eaa63",  # skin-one-place.csv
    "e237d675f514fd4202a0d7552a0fecfebd53b0bf2092aa45f3573d97e5902857",  # skin-two-places.csv
    "ca462c13db4e49025a0bf12b77082fa791af911827fb8ab0b14113fcb27eaf26",  # sponge-10mm-cycles.csv
    "56441275887d8ad2eeba79839b6c6ac13a64dba34f4a14275095d60bdbdcdaa8",  # sponge-30mm-cycles.csv
    "871c16b8fbe86f2146f38d64ce3d055ee155f8aafa0bc19c0a9f443a7da88c39",  # sponge-50mm-cycles.csv
    "d84bdb5530d7463e5616cb650759d7ba5d05c650de6ea588491ff6ec7842cc39",  # sponge-50mm-minor-loops.csv
    "2545445f6891703ceef1aee1b045169c9d7c81ff9207cf1c8bd9e58c1489c7d4",  # sponge-50mm-mixed-cycles.csv
))  # fmt: skip
"""SHA-256 of each; `python -m benchmarks.datasets` writes the files."""


def is_synthetic(sha256: str | None) -> bool:
    """Whether a file with this checksum was made by a virtual rig of ours."""
    return sha256 in SYNTHETIC
