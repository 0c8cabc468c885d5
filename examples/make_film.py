"""Makes the example film, examples/film-2/film.mp4: the independent integrator's cradle, seen by a model of a camera.

    python examples/make_film.py [FILE]

Two steel bobs of 4 cm for 20 s at 30 frames a second. One is held for 0.6 s and then released. The camera is turned by
half a degree and rolled by as much, the picture has noise, a pattern behind the bobs and glare, and H.264 compresses
it. It needs the extra `video`.
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

#: What is hidden in the film.
TRUE = {"k_f": 18000.0, "kappa": 190.0, "b": 0.002}
ANGLE, SEED = 0.2, 7


def make(path: Path, duration: float = 20.0):
    """Writes the film, and returns what is true of it: the `Truth` of studies/film/made.py."""
    sys.path.insert(0, str(ROOT))
    from studies.film import made
    from studies.film.camera import Camera

    camera = Camera(
        size=(480, 240), focal=960.0, roll=0.01, yaw=0.01, rate=30.0, exposure=0.2, noise=2.0, texture=3.0, glare=10.0
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    case = made.Case(2, {2: ANGLE}, duration, held=0.6, camera=camera, soft=True, seed=SEED, truth=TRUE)
    return made.make(path, case)


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "examples" / "film-2" / "film.mp4")
