import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from selftouch_drake.sweep.table import read_table


@pytest.mark.parametrize("content", [b"", b"PAR1", b"PAR1" * 9, b"{}"])
def test_a_damaged_table_is_reported(content, tmp_path):
    path = tmp_path / "table.parquet"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"is damaged .*; run the sweep again"):
        read_table(path)


def test_a_foreign_table_is_reported(tmp_path):
    path = tmp_path / "table.parquet"
    pq.write_table(pa.table({"q": np.arange(3)}), path)
    with pytest.raises(ValueError, match="is not the table of a sweep"):
        read_table(path)
