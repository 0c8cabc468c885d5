"""A film of five balls, one let go: how they fall into step, as a GIF, and a still.

    python examples/film.py [--out DIR] [--seconds S]

docs/film.gif is what it makes.
"""

import argparse
from pathlib import Path

from PIL import Image

from cradle_env import Cradle, Release, simulate
from cradle_env.rendering import Canvas, save_animation, scenes

FPS = 15
#: The film runs so many times as fast as life.
SPEED = 2.0
SIZE = (480, 360)  # pixels
#: The still shows this moment [s]: the first ball is out, the last has just been hit.
STILL = 0.35


def main() -> None:
    """Writes film.gif and still.png."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the results")
    parser.add_argument("--seconds", type=float, default=24.0, help="simulated time")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    run = simulate(Cradle(bobs=5), Release(angle=0.5), duration=options.seconds)
    canvas = Canvas(SIZE)
    frames = [canvas.draw(scene) for scene in scenes(run, FPS, SPEED)]
    Image.fromarray(frames[min(round(STILL * FPS / SPEED), len(frames) - 1)]).save(options.out / "still.png")
    save_animation(frames, options.out / "film.gif", FPS)
    print(f"Look at {options.out / 'film.gif'} and {options.out / 'still.png'}")


if __name__ == "__main__":
    main()
