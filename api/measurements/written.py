"""Measurements as a sender writes them."""

from __future__ import annotations

import io

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from api.measurements.columns import WORDS
from station.batches import Batch
from station.measurement import TagMap


def parquet_of(batch: Batch, tags: TagMap) -> bytes:
    """A batch as a Parquet file of the columns that services read."""
    words = sorted(WORDS, key=lambda word: WORDS[word])
    table = pa.table(
        {
            "tag": pa.DictionaryArray.from_arrays(batch.tag.astype(np.int32), [tag.tag for tag in tags.tags]),
            "time": batch.time,
            "value": batch.value,
            "quality": pa.DictionaryArray.from_arrays(batch.quality.astype(np.int32), words),
        }
    )
    stream = io.BytesIO()
    parquet.write_table(table, stream)
    return stream.getvalue()
