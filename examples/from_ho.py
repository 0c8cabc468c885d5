"""The paper's own story, found by the data: from the harmonic oscillator to nonlinear spring pendulums.

    python examples/from_ho.py [--out DIR]

The example's data come from an independent integrator of the whole cradle. Here they meet the paper's first model, HO,
and the diagnosis says what it lacks: each effect that it adds closes part of the gap. DIR gets the report, and
from-ho.png.
"""

import argparse
from pathlib import Path

from cradle_env.plot_style import BLUE, GREEN, GREY, RED, png, quiet_grid, styled
from identification import Experiment, diagnose
from identification.diagnosis.report import save
from identification.diagnosis.result import Diagnosis
from identification.reporting.terminal import TerminalProgress

ROOT = Path(__file__).resolve().parent
#: Last swings shown [s].
CLOSE_UP = 4.0


@styled
def figure(diagnosis: Diagnosis):
    """The gap after each step, and the last swings of the lifted bob with the first model and the last."""
    from matplotlib.figure import Figure

    steps = diagnosis.repaired.steps
    names = ["HO", *(f"+ {step.effect}" for step in steps)]
    fits = [diagnosis.base, *(step.after for step in steps)]
    gaps = [fitted.held_out_gap() for fitted in fits]
    drawn = Figure(figsize=(10.0, 3.2), layout="constrained")
    left, right = drawn.subplots(1, 2, width_ratios=(1.0, 1.25))
    left.plot([fitted.training_gap() for fitted in fits], range(len(fits)), "s:", color=GREEN, label="where fitted")
    left.plot(gaps, range(len(gaps)), "o-", color=BLUE, label="held out")
    for y, gap in enumerate(gaps):
        left.annotate(f"{gap:.3g}", (gap, y), xytext=(8, 0), textcoords="offset points", va="center")
    left.legend(loc="lower right")
    left.axvline(1.0, color=GREY, linestyle="--")
    left.set_xscale("log")
    left.set_xlim(0.7, 3.0 * max(gaps))
    left.set_yticks(range(len(names)), names)
    left.set_ylim(len(names) - 0.5, -0.5)
    left.set_xlabel("gap [noise]; dashed: nothing but noise")
    quiet_grid(left, "x")
    run = diagnosis.experiment.runs[0]
    rows = run.times > run.times[-1] - CLOSE_UP
    right.plot(run.times[rows], run.readings[rows, -1], ".", color=GREY, markersize=3.0, label="data")
    for name, fitted, colour in (("HO", diagnosis.base, RED), ("repaired", diagnosis.repaired.last.fitted, GREEN)):
        model = fitted.likelihood.predict(fitted.point, 0, rows)[0][:, -1]
        right.plot(run.times[rows], model, color=colour, linewidth=1.0, label=name)
    right.set_xlabel("time [s]")
    right.set_ylabel(f"θ{len(run.readings[0])} [rad]")
    right.set_title("predicted: fitted to the first 30 s alone")
    right.legend(loc="upper right", ncols=3)
    quiet_grid(right)
    return drawn


def main(out: Path) -> Diagnosis:
    """Diagnoses the example under HO; prints the steps; writes the report and the picture."""
    with TerminalProgress() as tell:
        diagnosis = diagnose(Experiment.load(ROOT / "ring-2" / "from-ho.toml"), out=out, progress=tell)
    content = save(diagnosis, out)
    print(f"HO: gap {diagnosis.base.training_gap():.3g} where fitted, {content['gap_first']:.3g} held out")
    for step in content["steps"]:
        print(f"+ {step['effect']}: {step['train_after']:.3g}, {step['gap_after']:.3g}")
    (out / "from-ho.png").write_bytes(png(figure(diagnosis)))
    print(f"report: {out / 'report.html'}, picture: {out / 'from-ho.png'}")
    return diagnosis


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/from-ho"), help="folder for the results")
    main(parser.parse_args().out)
