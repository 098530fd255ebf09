from pathlib import Path

import pytest

from harness.common.errors import InputError
from harness.truth.network.lanegraph import read_walls
from harness.truth.network.limits import check_xml


def polygons(folder: Path, content: str) -> Path:
    file = folder / "osm.poly.xml"
    file.write_text(f"<additional>{content}</additional>", encoding="utf-8")
    return file


def test_a_building_has_as_many_walls_as_sides_though_its_outline_is_open(tmp_path: Path) -> None:
    square = '<poly id="b" type="building.yes" color="red" fill="1" layer="0" shape="0,0 10,0 10,5 0,5"/>'
    park = '<poly id="p" type="park" color="green" fill="1" layer="0" shape="0,0 9,0 9,9"/>'
    walls = read_walls([polygons(tmp_path, square + park)])
    assert walls.tolist() == [[0, 0, 10, 0], [10, 0, 10, 5], [10, 5, 0, 5], [0, 5, 0, 0]]


@pytest.mark.parametrize("shape", ["0,0 nan,1 2,2", "0,0 1,x", '8.1,47.2 8.2,47.2 8.2,47.3" geo="1'])
def test_corners_that_are_no_places_of_the_plane_are_refused_in_words(tmp_path: Path, shape: str) -> None:
    file = polygons(tmp_path, f'<poly id="b" type="building" color="red" shape="{shape}"/>')
    with pytest.raises(InputError, match="poly b"):
        check_xml(file) or read_walls([file])
