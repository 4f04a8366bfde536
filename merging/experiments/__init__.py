"""The experiments of the paper on which this project is based, on maps with known relative poses."""
