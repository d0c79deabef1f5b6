"""``safestage bench learn export|train``."""

from __future__ import annotations

from pathlib import Path

import click

from safestage_eval.cli.outputs import Output
from safestage_eval.cli.terminal import say

from .simulate_options import BadInput, explains, jobs_option, progress


@click.group()
def learn() -> None:
    """Train policies of your own from recordings: export them, then train."""


@learn.command()
@click.argument("traces", nargs=-1, required=True)
@click.option(
    "--out", "-o", required=True, type=Output(file=False, folder=True),
    help="New folder for the dataset.",
)  # fmt: skip
@click.option(
    "--failures", is_flag=True, help="Keep episodes that did not reach their goal as well."
)
@jobs_option
@explains
def export(traces: tuple[str, ...], out: Path, failures: bool, jobs: int) -> None:
    """Write recorded rollouts as a LeRobot dataset (v3): what was seen, commanded and asked, at 15 Hz.

    TRACES are files or folders that `safestage bench record` wrote. Episodes end at their success. Each is
    judged by its task's own rules, so that safe and unsafe ways can be distinguished:
    `safestage.violation` in meta/episodes. There are no pictures;
    `observation.environment_state` has a slot for each object's pose.

    \b
    Examples:
      safestage bench record --policy demonstration:safe --policy demonstration:unsafe --seeds 0-9 --out demos
      safestage bench learn export demos --out dataset
    """
    from functools import partial

    from safestage_eval.formats import discover
    from simulate.learn.export_dataset import export_dataset
    from simulate.record.worker_pool import run_many

    refs = discover(list(traces))
    with progress(len(refs), "episode") as show:
        spread = partial(run_many, jobs=jobs, done=show)
        done = export_dataset(refs, out, failures=failures, spread=spread)
    for problem in done.problems:
        say(f"problem: {problem}", err=True)
    say(f"{done.kept} episodes, {done.steps:,} control steps in {out}" + (
        f"; {done.left_out} left out that did not reach their goal" if done.left_out else ""
    ))  # fmt: skip
    if done.problems:
        raise BadInput(f"{len(done.problems)} of {len(refs)} episodes could not be exported")


@learn.command()
@click.argument("kind", type=click.Choice(["bc", "act", "diffusion"]))
@click.option(
    "--data", "folders", required=True, multiple=True,
    type=click.Path(path_type=Path, file_okay=False), help="Dataset of `learn export`. Repeatable.",
)  # fmt: skip
@click.option(
    "--out", "-o", required=True, type=Output("onnx", stream=False, beside=lambda out, _: [out.with_suffix(".csv")]),
    help="ONNX file to write; its curve is written beside it as .csv.",
)  # fmt: skip
@click.option("--seed", default=0, show_default=True, help="Seed of weights, batches and noise.")
@click.option("--steps", type=click.IntRange(1), help="Steps of training. Default: the recipe's.")
@click.option("--threads", type=click.IntRange(1), default=1, show_default=True)
@click.option(
    "--device", default="cpu", show_default=True, metavar="cpu|cuda[:N]",
    help="Where to train. Weights differ from device to device.",
)  # fmt: skip
@explains
def train(
    kind: str,
    folders: tuple[Path, ...],
    out: Path,
    seed: int,
    steps: int | None,
    threads: int,
    device: str,
) -> None:
    """Train a policy from demonstrations, and write it as a checkpoint that `record` can roll out.

    KIND is bc (behaviour cloning, one step at a time), act (chunks of actions with a latent) or
    diffusion. Needs PyTorch: pip install 'safestage[learn]'. The same seed, data and number of threads give the same checkpoint on the same machine and device.

    \b
    Examples:
      safestage bench learn train act --data dataset --out act.onnx
      safestage bench record --policy learned:act.onnx --seeds 100-102 --out rollouts
    """
    import csv
    import importlib.util
    import os

    missing = [
        name for name in ("torch", "onnx", "onnxscript") if not importlib.util.find_spec(name)
    ]
    if missing:
        raise BadInput(f"{', '.join(missing)} not installed: pip install 'safestage[learn]'")
    if out.suffix != ".onnx":
        raise click.UsageError(f"--out {out}: name an .onnx file")
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # else cuBLAS is not deterministic
    import torch

    from simulate.learn.training import STEPS, Recipe, export_onnx
    from simulate.learn.training import train as fit
    from simulate.learn.training_data import read_dataset

    torch.set_num_threads(threads)
    torch.use_deterministic_algorithms(mode=True)
    gpus = [f"cuda:{i}" for i in range(torch.cuda.device_count())]
    allowed = ["cpu", *(["cuda", *gpus] if gpus else [])]
    if device not in allowed:
        raise click.UsageError(
            f"--device {device}: PyTorch {torch.__version__} sees no such device. "
            f"Allowed: {', '.join(allowed)}"
        )
    data = read_dataset(list(folders))
    recipe = Recipe(kind, steps or STEPS[kind], seed)
    said = f"{len(data.usable):,} control steps of {len(set(data.first.tolist())):,} episodes"
    say(f"{kind}: {recipe.steps:,} steps of {recipe.batch} on {said}")
    network, curve = fit(
        data, recipe, lambda row: say("  ".join(f"{k} {v:g}" for k, v in row.items())), device
    )  # fmt: skip
    export_onnx(network, out, recipe, {"data": said})
    with out.with_suffix(".csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(curve[0]))
        table.writeheader()
        table.writerows(curve)
    say(f"{out}, {out.stat().st_size / 1e6:.1f} MB")
