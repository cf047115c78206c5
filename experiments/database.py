# SPDX-License-Identifier: BSD-3-Clause
"""Makes the database of a sequence: features, rig and verified matches."""
import pathlib

from experiments.measure import StepFailed, run_step
from experiments.records import write_json


def make_database(settings, sequence):
    """The path of the database, made unless it is given or finished.

    An interrupted extraction or matching continues. Throws StepFailed if the
    folder holds a database of other images or cameras.
    """
    if sequence.database:
        return pathlib.Path(sequence.database).resolve()
    folder = settings.folder_of(sequence)
    database = folder / "database.db"
    done = folder / "view_graph.json"
    write_inputs(folder, sequence, database)
    if done.exists():
        return database
    print(f"{sequence.name}: features and matches", flush=True)
    features = extract_features(settings, sequence, folder, database)
    if sequence.rig_prefixes:
        configure_rig(settings, sequence, folder, database)
    matches = run_step(settings.mgsfm(
        "sequential_matcher", "--database_path", database),
        folder / "matches.log")
    write_json(done, {"features": features, "matches": matches})
    return database


def write_inputs(folder, sequence, database):
    """The lists of images and cameras; they must not change between runs."""
    for path, lines in ((folder / "images.txt", sequence.image_list),
                        (folder / "cameras.txt", sequence.camera_lines)):
        text = "".join(f"{line}\n" for line in lines)
        if database.exists() and path.read_text() != text:
            raise StepFailed(f"{database} was made of other images or cameras; "
                             "choose another --work")
        path.write_text(text)


def extract_features(settings, sequence, folder, database):
    """Runs feature_extractor; returns its cost."""
    masks = (["--ImageReader.mask_path", sequence.mask_path]
             if sequence.mask_path else [])
    log = folder / "features.log"
    cost = run_step(settings.mgsfm(
        "feature_extractor", "--database_path", database,
        "--image_path", sequence.image_path,
        "--image_list_path", folder / "images.txt",
        "--ImageReader.camera_params_path", folder / "cameras.txt", *masks),
        log)
    # Warnings, such as masks without an image.
    print(log.read_text(errors="replace"), end="")
    return cost


def configure_rig(settings, sequence, folder, database):
    """Makes one rig of the cameras, with unknown poses."""
    config = folder / "rig_config.json"
    cameras = [{"image_prefix": p} for p in sequence.rig_prefixes]
    cameras[0]["ref_sensor"] = True
    write_json(config, [{"cameras": cameras}])
    run_step(settings.mgsfm("rig_configurator", "--database_path", database,
                            "--rig_config_path", config),
             folder / "rig.log")
