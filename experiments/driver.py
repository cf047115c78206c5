# SPDX-License-Identifier: BSD-3-Clause
"""The recipe of every driver of a data set: prepare, run, tables, figures.

A driver calls prepare() before it reads the data set, so that a missing
program, method or Python package ends the call before any run.
"""
import dataclasses

from experiments import methods, options, paper_tables, peers, requirements
from experiments import tables
from experiments.measure import StepFailed
from experiments.runner import Runner, Settings, find_record


@dataclasses.dataclass(frozen=True)
class Plan:
    """The methods to run, and the settings of all runs."""

    settings: Settings
    methods: list
    draw_figures: bool


@dataclasses.dataclass
class Results:
    """Records by (sequence, method), and the number of runs that failed."""

    records: dict
    num_failed: int

    def end(self):
        """Ends a driver with an error if runs failed."""
        if self.num_failed:
            raise SystemExit(f"{self.num_failed} of the runs failed; the same "
                             "command runs only what is missing")


def prepare(arguments):
    """Checks all that the runs need, and chooses the methods."""
    added = [parse_external(text) for text in arguments.external]
    methods.check_names(added)
    if not arguments.no_pictures:
        requirements.require("matplotlib", "figures (see --no_pictures)")
    installed = peers.find_installed()
    if arguments.only_done:
        installed = {**peers_of_records(arguments.work), **installed}
    else:
        peers.check_programs(added)
        arguments.program = options.find_program(arguments.program)
    chosen = methods.choose(arguments.methods, installed,
                            [peer.name for peer in added])
    found = {**installed, **{peer.name: peer for peer in added}}
    for peer in found.values():
        print(f"{peer.name}: {peer.version}")
    return Plan(Settings.of(arguments, found), chosen,
                not arguments.no_pictures)


def parse_external(text):
    """The Peer of one --external."""
    try:
        return peers.parse_external(text)
    except ValueError as error:
        raise SystemExit(f"--external: {error}") from None


def peers_of_records(work):
    """{name: Peer} of the known peers that earlier runs left records of."""
    return {name: dataclasses.replace(peer, version="run earlier")
            for name, peer in peers.KNOWN.items()
            if any(work.glob(f"*/{name}.json"))}


def run(plan, sequences, title):
    """Runs the methods on the sequences, writes tables, draws figures."""
    settings = plan.settings
    runs = runs_of(plan, sequences)
    if not runs:
        raise SystemExit(f"nothing is done in {settings.work}"
                         if settings.only_done else "no sequence or method")
    runner, found, num_failed = Runner(settings), [], 0
    for sequence, method in runs:
        try:
            found.append(runner.run(sequence, method))
        except StepFailed as failure:
            print(f"{sequence.name:12} {method:26} failed: {failure}",
                  flush=True)
            num_failed += 1
            if failure.record:
                found.append(failure.record)
    by_name = records_by_name(found, sequences)
    if found:
        write_tables(plan, by_name, found, title)
    compared = [r for r in found if is_main(plan, r["method"])]
    if compared and plan.draw_figures:
        from experiments.figures import dataset  # needs matplotlib
        dataset.draw(settings.work, sequences, compared)
    return Results(by_name, num_failed)


def runs_of(plan, sequences):
    """(sequence, method) of each run; a method with two names runs once."""
    different = dict.fromkeys(methods.SAME_AS.get(m, m) for m in plan.methods)
    return [(sequence, method)
            for sequence in sequences for method in different
            if not plan.settings.only_done
            or find_record(plan.settings, sequence, method)]


def is_main(plan, method):
    """True for complete methods, false for members of the ablation."""
    return method in methods.OURS or method in plan.settings.peers


def records_by_name(found, sequences):
    """{(sequence, method): record}, under both names of a method."""
    by_name = {(r["sequence"], r["method"]): r for r in found}
    for sequence in sequences:
        for method, same in methods.SAME_AS.items():
            if (sequence.name, same) in by_name:
                by_name[sequence.name, method] = by_name[sequence.name, same]
    return by_name


def write_tables(plan, by_name, found, title):
    """WORK/tables.*, with all records in the JSON file."""
    groups = [[m for m in plan.methods if belongs(m)] for belongs in (
        lambda m: is_main(plan, m), methods.ABLATION.__contains__,
        methods.AVERAGED.__contains__)]
    versions = {name: peer.version
                for name, peer in plan.settings.peers.items()}
    tables.write(paper_tables.make_tables(by_name, groups),
                 plan.settings.work / "tables",
                 {"title": title, "versions": versions, "records": found})
