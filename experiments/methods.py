# SPDX-License-Identifier: BSD-3-Clause
"""The methods of mgsfm that are compared, and the choice of methods."""
from experiments import peers
from experiments.options import words_of

INPUTS = {"translations": "relative_translations", "tracks": "tracks",
          "hybrid": "hybrid"}
OBJECTIVES = ("bilinear", "non_bilinear")
ABLATION = [f"{name}_{objective}" for name in INPUTS
            for objective in OBJECTIVES]
# Members of the ablation that are methods by another name.
SAME_AS = {"tracks_bilinear": "dmra_mgp", "hybrid_non_bilinear": "mgsfm"}
# The result of averaging, before bundle adjustment makes methods alike: poses
# are fixed, points only triangulated.
AVERAGED = [f"{name}_averaged" for name in ABLATION]
FIXED_POSES = ["--BundleAdjustment.refine_rig_from_world", "false",
               "--BundleAdjustment.refine_sensor_from_rig", "no"]
OURS = ["mgsfm", "dmra_mgp", "mma", "incremental", "single"]
BUILT_IN = [*OURS, *ABLATION, *AVERAGED]


def mapper_options_of(method):
    """The options of `mgsfm mapper` that select a built-in method."""
    if method in OURS:
        return ["--method", method]
    name, objective = method.split("_", 1)
    objective, averaged, _ = objective.partition("_averaged")
    return ["--TranslationAveraging.input", INPUTS[name],
            "--TranslationAveraging.objective", objective,
            *(FIXED_POSES if averaged else [])]


def check_names(added):
    """Ends with one line if an external method takes a name twice."""
    names = [*BUILT_IN, *peers.KNOWN, "all", "paper", "ablation"]
    for peer in added:
        if peer.name in names:
            raise SystemExit(f"--external {peer.name}: the name is taken")
        names.append(peer.name)


def choose(text, installed, added=()):
    """The names of the methods that --methods selects, without repetition.

    installed: names of known peers on this machine. added: names of external
    methods; they take part in every run.
    """
    groups = {"all": [*OURS, *installed, *ABLATION, *AVERAGED],
              "paper": [*OURS, *installed],
              "ablation": [*ABLATION, *AVERAGED]}
    names = [*BUILT_IN, *installed, *added]
    chosen = []
    for word in words_of(text):
        if word in groups:
            chosen += groups[word]
        elif word in names:
            chosen.append(word)
        elif word in peers.KNOWN:
            raise SystemExit(f"{word} is not installed")
        else:
            raise SystemExit(f"unknown method '{word}'; there are "
                             + ", ".join([*groups, *OURS, *peers.KNOWN, *added,
                                          *ABLATION, *AVERAGED]))
    return list(dict.fromkeys([*chosen, *added]))
