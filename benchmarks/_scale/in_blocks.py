"""A Preisach grid fitted to a Parquet file that need not fit into memory.

python -m benchmarks._scale.in_blocks FILE

FILE has the columns input, from -1 to 1, and output. Prints the rms error.
"""

import sys

import jax
from pyarrow.parquet import ParquetFile

import identify

if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    batches = ParquetFile(sys.argv[1]).iter_batches(1_000_000)
    blocks = ((rows["input"].to_numpy(), rows["output"].to_numpy()) for rows in batches)
    print(identify.fit_density_in_blocks(blocks, 50, low=-1.0, high=1.0).rmse)
