# SPDX-License-Identifier: BSD-3-Clause
"""The choice of methods, and external ones."""
import pytest

from experiments import methods, peers


def test_groups_of_methods():
    assert methods.choose("paper", ["colmap"]) == [*methods.OURS, "colmap"]
    assert methods.choose("mma,paper", []) == [
        "mma", "mgsfm", "dmra_mgp", "incremental", "single"]
    assert len(methods.choose("ablation", [])) == 12
    assert set(methods.choose("all", ["glomap"])) == {
        *methods.BUILT_IN, "glomap"}


def test_unknown_and_absent_methods_are_named():
    with pytest.raises(SystemExit, match="unknown method 'mmb'"):
        methods.choose("mmb", [])
    with pytest.raises(SystemExit, match="glomap is not installed"):
        methods.choose("glomap", ["colmap"])


def test_options_of_built_in_methods():
    assert methods.mapper_options_of("mma") == ["--method", "mma"]
    assert methods.mapper_options_of("translations_non_bilinear") == [
        "--TranslationAveraging.input", "relative_translations",
        "--TranslationAveraging.objective", "non_bilinear"]
    averaged = methods.mapper_options_of("hybrid_bilinear_averaged")
    assert averaged[3] == "bilinear"
    assert averaged[4:] == methods.FIXED_POSES


def test_external_methods_take_part_in_every_run():
    assert methods.choose("mma", [], ["mine"]) == ["mma", "mine"]
    assert methods.choose("mine,mma", [], ["mine"]) == ["mine", "mma"]


def test_commands_are_filled_in():
    peer = peers.parse_external(
        "mine=my_mapper --in {database} --out={output}/0 'two words' "
        "-j {threads} {images}")
    assert peer.name == "mine"
    assert peer.command({"database": "/a b/d.db", "output": "/o",
                         "images": "/i", "threads": 2}) == [
        "my_mapper", "--in", "/a b/d.db", "--out=/o/0", "two words", "-j", "2",
        "/i"]


def test_colmap_has_a_comparable_start():
    command = peers.KNOWN["colmap"].command({
        "database": "d", "output": "o", "images": "i", "threads": 3})
    assert command[:8] == ["colmap", "mapper", "--database_path", "d",
                           "--output_path", "o", "--image_path", "i"]
    assert command[command.index("--Mapper.num_threads") + 1] == "3"
    assert command[command.index("--Mapper.ba_refine_focal_length") + 1] == "0"


@pytest.mark.parametrize("text, message", [
    ("mine", "is not NAME="),
    ("a b=x {database} {output}", "is not NAME="),
    ("mine=x {database}", "does not use {output}"),
    ("mine=x {output}", "does not use {database}"),
    ("mine=x {database} {output} {image}", "uses {image}"),
    ("mine=x '{database} {output}", "command of mine"),
])
def test_wrong_external_methods(text, message):
    with pytest.raises(ValueError, match=message):
        peers.parse_external(text)


@pytest.mark.parametrize("name", ["mgsfm", "colmap", "hybrid_bilinear", "all"])
def test_names_of_external_methods_are_free(name):
    peer = peers.parse_external(f"{name}=x {{database}} {{output}}")
    with pytest.raises(SystemExit, match="the name is taken"):
        methods.check_names([peer])


def test_an_external_name_is_given_once():
    peer = peers.parse_external("mine=x {database} {output}")
    methods.check_names([peer])
    with pytest.raises(SystemExit, match="the name is taken"):
        methods.check_names([peer, peer])


def test_a_missing_external_program_is_named():
    peer = peers.parse_external("mine=/no/such/program {database} {output}")
    with pytest.raises(SystemExit, match="no program /no/such/program"):
        peers.check_programs([peer])
