# SPDX-License-Identifier: BSD-3-Clause
"""Records of runs: one JSON file for each sequence and method."""
import json

from experiments import measure, methods

# Exit codes of mgsfm that are results: a model, or nothing to reconstruct.
# Others mean wrong options, a full disk or a defect.
RESULTS = (0, 2)
# Stages outside the run time of the paper's tables.
NOT_COUNTED = ("reading", "view graph", "writing")


def write_json(path, value):
    """Writes the whole file or nothing."""
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(value, indent=2) + "\n")
    part.replace(path)


def is_result(record):
    """True if a record is the outcome of its method: a model, no model, or the
    time limit. No model of a peer may be a mistake in its command."""
    if record["method"] not in methods.BUILT_IN:
        return record["is_stopped"] or "model" in record
    return record["is_stopped"] or record["exit_code"] in RESULTS


def add_stages(record, report):
    """Adds costs by stage, and the sums that the run-time tables show."""
    record["stages"] = measure.stages_of(report)
    for kind in ("seconds", "processor_seconds"):
        record[f"{kind}_counted"] = sum(
            stage[kind] for name, stage in record["stages"].items()
            if name not in NOT_COUNTED)


def print_record(record):
    """One line on a finished run."""
    line = f"{record['sequence']:12} {record['method']:26}"
    errors = record.get("errors")
    if record["exit_code"] != 0:
        why = "time limit" if record["is_stopped"] else "no model"
        print(f"{line} {why} after {record['seconds']:.1f} s", flush=True)
        return
    line += f" {record.get('seconds_counted', record['seconds']):8.1f} s"
    if errors and errors.get("position_m"):
        line += (f"  position {errors['position_m']['mean']:.4f} m"
                 f"  rotation {errors['rotation_deg']['mean']:.4f} deg"
                 f"  {errors['num_registered']} of {errors['num_images']}")
    print(line, flush=True)
