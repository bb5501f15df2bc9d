from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dbc.errors import InputError
from drivers.nuscenes import (
    MAX_POINTS,
    POINT,
    RadarCloud,
    cloud_bytes,
    new_cloud,
    read_cloud,
    scan_of,
    with_scan,
)


def points(**columns: Any) -> Any:
    length = max((np.size(column) for column in columns.values()), default=1)
    made = np.zeros(length, POINT)
    for name, column in columns.items():
        made[name] = column
    return made


def written(tmp_path: Path, cloud: RadarCloud) -> Path:
    path = tmp_path / "a.pcd"
    path.write_bytes(cloud_bytes(cloud))
    return path


@given(
    raw=hnp.arrays(np.uint8, st.tuples(st.integers(1, 40), st.just(POINT.itemsize))),
    tail=st.binary(min_size=1, max_size=40),
)
def test_reading_and_writing_changes_no_byte(
    tmp_path_factory: pytest.TempPathFactory, raw: Any, tail: bytes
) -> None:
    some = raw.view(POINT).reshape(-1)
    some["x"][0] = 1.5  # a NaN there would be an empty cloud
    path = tmp_path_factory.getbasetemp() / "any.pcd"
    content = new_cloud(some).header + some.tobytes() + tail
    path.write_bytes(content)
    cloud = read_cloud(path)
    assert cloud.points.tobytes() == some.tobytes()
    assert cloud_bytes(cloud) == content


def test_the_header_is_the_data_sets() -> None:
    lines = new_cloud(points(x=[1, 2])).header.decode().splitlines()
    assert lines[3] == "SIZE 4 4 4 1 2 4 4 4 4 4 1 1 1 1 1 1 1 1"
    assert lines[4] == "TYPE F F F I I F F F F F I I I I I I I I"
    assert [lines[6], lines[9], lines[10]] == ["WIDTH 2", "POINTS 2", "DATA binary"]
    assert POINT.itemsize == 43


def test_a_byte_follows_the_points_because_the_data_sets_readers_want_one() -> None:
    cloud = new_cloud(points(x=[1, 2]))
    assert len(cloud_bytes(cloud)) > len(cloud.header) + 2 * POINT.itemsize
    bare = RadarCloud(cloud.points, cloud.header, b"")
    assert len(cloud_bytes(bare)) > len(cloud.header) + 2 * POINT.itemsize


def test_an_empty_cloud_is_one_point_of_nan(tmp_path: Path) -> None:
    path = written(tmp_path, new_cloud(points(x=[1])[:0]))
    assert b"WIDTH 1\n" in path.read_bytes()
    cloud = read_cloud(path)
    assert len(cloud) == 0
    scan = scan_of(cloud, "radar", 3, path)
    assert (len(scan), scan.near, scan.far, scan.sequence) == (0, 0, 0, 3)


def test_fewer_points_keep_header_and_tail(tmp_path: Path) -> None:
    path = written(tmp_path, new_cloud(points(x=np.arange(1, 6), z=7)))
    cloud = read_cloud(path)
    few = read_cloud(written(tmp_path, RadarCloud(cloud.points[1:3], cloud.header, b"tail")))
    assert few.points["x"].tolist() == [2, 3]
    assert few.tail == b"tail"
    assert few.header.count(b" 2\n") == 2


def test_the_far_list_begins_where_the_range_steps_back(tmp_path: Path) -> None:
    x = [5.0, 9.0, 8.8, 60.0, 20.0, 180.0]
    scan = scan_of(new_cloud(points(x=x)), "radar", 0, tmp_path)
    assert (scan.near, scan.far) == (4, 2)
    assert scan_of(new_cloud(points(x=x[:4])), "radar", 0, tmp_path).far == 0


def test_a_scan_goes_back_with_what_it_does_not_say(tmp_path: Path) -> None:
    cloud = new_cloud(points(x=[1, 2, 3], z=[7, 8, 9], pdh0=[1, 3, 6], is_quality_valid=1))
    scan = scan_of(cloud, "radar", 0, tmp_path)
    assert cloud_bytes(with_scan(cloud, scan))[:-1] != b""
    back = with_scan(cloud, scan).points
    assert {name: back[name].tolist() for name in ("x", "z", "id", "pdh0", "is_quality_valid")} == {
        "x": [1, 2, 3],
        "z": [7, 8, 9],
        "id": [0, 1, 2],
        "pdh0": [1, 3, 6],
        "is_quality_valid": [1, 1, 1],
    }


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (b"DATA binary", b"DATA ascii", ":11: DATA ascii"),
        (b"FIELDS x y z", b"FIELDS x y w", ":3: FIELDS"),
        (b"SIZE 4", b"SIZE 8", ":4: SIZE"),
        (b"HEIGHT 1", b"HEIGHT 2", ":8: HEIGHT"),
        (b"POINTS 3", b"POINTS 4", "same number"),
        (b"WIDTH 3", b"WIDTH -3", "same number"),
        (b"WIDTH 3\n", b"", "no WIDTH"),
        (b"DATA binary\n", b"", "no PCD header"),
    ],
)
def test_what_is_no_radar_file_is_refused_in_one_line(
    tmp_path: Path, old: bytes, new: bytes, expected: str
) -> None:
    path = written(tmp_path, new_cloud(points(x=[1, 2, 3])))
    path.write_bytes(path.read_bytes().replace(old, new))
    with pytest.raises(InputError, match=expected) as caught:
        read_cloud(path)
    assert str(path) in str(caught.value)


def test_a_file_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, new_cloud(points(x=[1, 2, 3])))
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match="2 of 3 points"):
        read_cloud(path)
    with pytest.raises(InputError, match="no such file"):
        read_cloud(tmp_path / "absent.pcd")


def test_more_points_than_ids_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="257 points"):
        scan_of(new_cloud(points(x=np.ones(MAX_POINTS + 1))), "radar", 0, tmp_path)
