#!/usr/bin/env python3
"""flatlight against what one would use instead (peer.py: OpenImageIO, NumPy, SciPy), in one run on the same two processors.

    benches/peer/run.py [--flatlight BINARY] [--cpus 0,1] [--repeat N] [--bare] SET...
    benches/peer/run.py --large [--rows FIRST:LAST] SET     against OpenImageIO reading the photographs and nothing else:
                                                            whole, and only the blocks that hold these rows
    benches/peer/run.py --large --rows FIRST:LAST --blocks BINARY SET   and against the exr crate inflating these blocks and nothing
                                                            else (`cargo bench --no-run --bench blocks` names the binary)

--bare: against a least-squares fit without limbs, error bars, sources and products as well.

Runs alternate, so that what else the machine does falls on both. A SET is a folder with capture.toml, recipe.toml and
views/; `cargo bench --bench set` writes such sets of any size. Needs a Python with OpenImageIO, NumPy and SciPy."""
import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", type=Path, nargs="+")
    parser.add_argument("--flatlight", type=Path, default=ROOT / "target/release/flatlight")
    parser.add_argument("--cpus", default="0,1")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--bare", action="store_true", help="compare with a bare least-squares fit, too")
    parser.add_argument("--large", action="store_true", help="compare with reading the photographs only")
    parser.add_argument("--rows", help="first:last, the scan lines that are needed")
    parser.add_argument("--blocks", type=Path, help="the bench `blocks`, to compare with the exr crate")
    options = parser.parse_args()
    os.sched_setaffinity(0, {int(c) for c in options.cpus.split(",")})
    peers = {"the peer": []}
    if options.bare:
        peers["a bare fit"] = ["--bare"]
    if options.large:
        peers = {"reading whole photographs": ["--read-only"]}
        if options.rows:
            peers["reading the blocks of the rows"] = ["--read-only", "--rows", options.rows]
    for folder in options.sets:
        ours, theirs = [], {name: [] for name in peers}
        for _ in range(options.repeat):
            with tempfile.TemporaryDirectory() as out:
                ours.append(timed([options.flatlight, "run", folder / "recipe.toml", "--capture", folder, "--out", Path(out) / "a",
                                   "--threads", "2", "--quiet"]))
                for name, more in peers.items():
                    out_too = ["--out", Path(out) / "b"] if name == "the peer" else []
                    theirs[name].append(timed([sys.executable, HERE / "peer.py", folder, *more, *out_too]))
        print(f"{folder}: flatlight, report included, {told(ours)}")
        if options.blocks and options.rows:
            least_of_blocks(options, folder, ours)
        for name, runs in theirs.items():
            print(f"    {name} {told(runs)}; {least(runs, 'wall') / least(ours, 'wall'):.1f} times by wall, "
                  f"{least(runs, 'inside') / least(ours, 'wall'):.1f} times without Python's start "
                  f"({least(runs, 'inside'):.2f} s), {least(runs, 'cpu') / least(ours, 'cpu'):.1f} times by processor time")


def least_of_blocks(options, folder, ours):
    """The exr crate on as many threads as the runs have, without anything else."""
    os.environ["RAYON_NUM_THREADS"] = "2"
    seconds = min(timed([options.blocks, folder, options.rows])["inside"] for _ in range(options.repeat))
    print(f"    the exr crate inflating the blocks of the rows {seconds:.3f} s; the whole run takes "
          f"{least(ours, 'wall') / seconds:.1f} times that")


def timed(command):
    # As many threads of linear algebra as processors; idle ones would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", str(len(os.sched_getaffinity(0))))
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        sys.exit(f"{command[0]} failed: {done.stderr}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    last = done.stdout.strip().splitlines()[-1]
    inside = json.loads(last)["seconds"] if last.startswith("{") else wall
    return {"wall": wall, "cpu": cpu, "inside": inside}


def least(runs, key):
    return min(run[key] for run in runs)


def told(runs):
    walls = sorted(run["wall"] for run in runs)
    return f"{walls[0]:.2f} s (median {walls[len(walls) // 2]:.2f} s, processor time {least(runs, 'cpu'):.2f} s)"


if __name__ == "__main__":
    main()
