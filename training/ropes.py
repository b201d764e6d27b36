"""The ropes that the networks of the closer look learn from, what is cut out of them, and what it shows."""

import argparse
import json
import random
import subprocess
from pathlib import Path

import numpy as np

METRES, TRAIN_M = 8, 2.5  # of every rope, and of those by which its model is trained
KINDS = ["broken_wire", "missing_wire", "corrosion", "arc_burn", "lifted_wire", "notch", "loose_wire", "abrasion"]
DAMAGE = {  # defects of a rope, and which
    "all": (36, []), "burns": (36, ["--defect-kind", "arc_burn"]), "none": (0, []),
    "gaps": (36, ["--defect-kind", "broken_wire"]), "missing wires": (36, ["--defect-kind", "missing_wire"]),
}
ROPES = [  # strands, wires, diameter, strand lay, wire lay; None: the usual one
    (6, 9, 32, None, None), (8, 7, 40, None, None), (8, 9, 36, -245, -88), (6, 9, 32, -220, 95), (6, 12, 28, None, None),
    (6, 10, 40, 290, 110), (7, 8, 32, None, None), (6, 9, 30, 210, -90), (5, 8, 30, None, None), (6, 8, 36, None, None),
    (8, 9, 44, None, None), (6, 11, 34, -235, 100),
]
HEAD = ("view", "line", "column", "score", "odds")  # what training/patches.rs tells of a suspect before its values


def options(seed, metres, defects):
    """Options of `simulate` for a rope, by chance."""
    chance = random.Random(seed)
    strands, wires, diameter, strand_lay, wire_lay = chance.choice(ROPES)
    lays = [f"--strand-lay-mm={strand_lay}", f"--wire-lay-mm={wire_lay}"] if strand_lay else []
    chosen = {
        "strands": strands, "wires": wires, "diameter-mm": diameter, "metres": metres, "defects": defects,
        "defect-free-m": TRAIN_M, "seed": seed, "dirt": chance.choice([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]),
        "exposure": round(chance.uniform(0.6, 1.4), 2), "gray-noise": round(chance.uniform(1.5, 4.5), 1),
        "oscillation-px": round(chance.uniform(2, 14), 1), "oil-spots-per-m": chance.choice([0, 0.5, 1, 2, 4]),
        "water": chance.choice([0, 0, 0, 0.05, 0.15]), "scratches-per-m": chance.choice([0, 1, 3, 8]),
        "debris-per-m": chance.choice([0, 2, 6, 10, 10]), "light-drift": chance.choice([0, 0.05, 0.1, 0.2]),
        "background": chance.choice(["dark", "dark", "dark", "bright"]), "gloss": round(chance.uniform(0.4, 1.8), 2),
        "lamp-spread": round(chance.uniform(0.5, 1.6), 2), "blur-px": round(chance.uniform(0.4, 0.9), 2),
        "defect-variety": round(chance.uniform(0, 1) ** 0.5, 2), "vignetting": round(chance.uniform(0.05, 0.35), 2),
        "bad-columns": chance.choice([0, 1, 1, 3]), "strand-jitter-rad": round(chance.uniform(0.02, 0.05), 3),
    }
    return lays + [word for key, value in chosen.items() for word in (f"--{key}", str(value))]


def run(*words):
    subprocess.run([str(word) for word in words], check=True, capture_output=True)


def cut(what, recording, model, data, program, shape):
    """Heads of all suspects of a recording by a model, `[suspect, HEAD]`, and their patches or details."""
    rows = data / f"{what}-{recording.name}-{model.stem}.f32"
    run(program.parent / "examples" / "patches", what, recording, model, rows)
    values = np.fromfile(rows, "<f4").reshape(-1, len(HEAD) + int(np.prod(shape)))
    rows.unlink()
    return values[:, : len(HEAD)], values[:, len(HEAD) :].reshape(-1, *shape)


def simulated(what, seed, damage, data, program, shape, kept_as):
    """Patches or details of a simulated rope, as they are kept, their heads, the defect that each shows (its number; -1 for intact rope), and
    its kind (its place in KINDS). Recordings stay in `data`, to be cut anew by a later network."""
    folder, model, kept = data / f"rope{seed}", data / f"rope{seed}.model", data / f"{what}{seed}.npz"
    if not kept.exists():
        if not model.exists():
            defects, which = DAMAGE[damage]
            run(program, "simulate", "--force", "--out", folder, *options(seed, METRES, defects), *which)
            run(program, "train", folder, "--to-m", TRAIN_M, "--out", model)
        head, values = cut(what, folder, model, data, program, shape)
        defect, kind, told = shown(json.loads((folder / "labels.json").read_text()), head, seed)
        np.savez(kept, values=kept_as(values[told]), head=head[told], defect=defect[told], kind=kind[told])
    found = np.load(kept)
    return tuple(found[name] for name in ("values", "head", "defect", "kind"))


def shown(labels, head, seed):
    """Which clear defect every suspect shows, its kind, and whether either is known."""
    view, line, column, _, odds = head.T
    defect, kind, unclear = np.full(len(head), -1), np.full(len(head), -1), np.zeros(len(head), bool)
    for label in labels:
        along = lambda pad: (line >= label["first_line"] - pad) & (line <= label["last_line"] + pad)
        in_view = view == label["view"]
        shows = in_view & along(5) & (column >= label["first_column"] - 6) & (column <= label["last_column"] + 6)
        # About a defect other views may show it where nobody labelled it: what looks like damage there is left out.
        unclear |= (in_view & along(120)) | (along(200) & (odds > -2))
        if label["clear"]:
            defect[shows], kind[shows] = seed * 1000 + label["defect"], KINDS.index(label["kind"])
    return defect, kind, (line > (TRAIN_M * 1000 + 100) * 10) & (~unclear | (defect >= 0))


def intact(what, recording, to_m, data, program, shape):
    """Heads and patches or details of intact rope, seen by another camera: of either half of a recording up to a metre, by a model of the other."""
    heads, values = [], []
    for taught, (from_m, end_m) in ((0, to_m / 2), (to_m / 2, to_m)), ((to_m / 2, to_m), (0, to_m / 2)):
        model = data / f"{recording.name}-{taught[0]}-{taught[1]}.model"
        if not model.exists():
            run(program, "train", recording, "--from-m", taught[0], "--to-m", taught[1], "--out", model)
        head, cuts = cut(what, recording, model, data, program, shape)
        told = (head[:, 1] > (from_m + 0.01) * 10000) & (head[:, 1] < (end_m - 0.01) * 10000)
        heads.append(head[told])
        values.append(cuts[told])
    return np.concatenate(heads), np.concatenate(values)


def gathered(what, chosen, shape, kept_as):
    """What is taught, what other cameras saw of intact rope (heads and values; None without), and what is held back: every fifth rope."""
    chosen.data.mkdir(parents=True, exist_ok=True)
    numbers = (chosen.ropes, chosen.burnt_ropes, chosen.intact_ropes, chosen.gap_ropes, chosen.missing_wire_ropes)
    ropes = [(chosen.first_seed + 1000 * k + n, damage) for k, (damage, of) in enumerate(zip(DAMAGE, numbers)) for n in range(of)]
    place = (chosen.data, chosen.program, shape)
    pooled = lambda parts: [np.concatenate(part) for part in zip(*parts)] if parts else None
    of = lambda held: pooled([simulated(what, *rope, *place, kept_as) for rope in ropes if (rope[0] % 5 == 3) == held])
    others = [(Path(recording), float(to_m)) for recording, to_m in (of.rsplit(":", 1) for of in chosen.intact)]
    cuts = [intact(what, *recording, *place) for recording in others]
    return of(False), pooled([(head, kept_as(values)) for head, values in cuts]), of(True)


def chosen_of(about, ropes, steps, of_step):
    """What was chosen of a program that learns from ropes: how many with which damage, in the order of DAMAGE, and so on."""
    words = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    options = ("--ropes", "--burnt-ropes", "--intact-ropes", "--gap-ropes", "--missing-wire-ropes")
    for option, number, damage in zip(options, ropes, DAMAGE):
        words.add_argument(option, type=int, default=number, help=f"ropes with such damage: {damage} (default {number})")
    words.add_argument("--first-seed", type=int, default=20000, help="of the ropes; those with other damage begin 1000, 2000, ... later")
    words.add_argument("--intact", action="append", default=[], metavar="RECORDING:TO_M", help="rope without damage, seen by another camera")
    words.add_argument("--steps", type=int, default=steps, help=f"each of {of_step} (default {steps})")
    words.add_argument("--from", dest="begin", type=Path, help="file of weights to go on from")
    words.add_argument("--keep", type=float, default=0.0, help="share of those weights that is kept in the mean with what was learnt (default 0)")
    words.add_argument("--program", type=Path, default=Path("target/release/ropescope"))
    words.add_argument("--data", type=Path, required=True, help="folder for ropes and what is cut out of them; what is there is used again")
    words.add_argument("--out", type=Path, required=True, help="file for the weights")
    chosen = words.parse_args()
    if chosen.keep and not chosen.begin:
        words.error("--keep needs --from: there are no weights before of which a share could be kept")
    return chosen
