"""The ropes that the networks of the closer look learn from, and how programs are run on them."""

import random
import subprocess

TRAIN_M = 2.5  # of every rope, by which its model is trained
KINDS = ["broken_wire", "missing_wire", "corrosion", "arc_burn", "lifted_wire", "notch", "loose_wire", "abrasion"]
ROPES = [  # strands, wires, diameter, strand lay, wire lay; None: the usual one
    (6, 9, 32, None, None), (8, 7, 40, None, None), (8, 9, 36, -245, -88), (6, 9, 32, -220, 95), (6, 12, 28, None, None),
    (6, 10, 40, 290, 110), (7, 8, 32, None, None), (6, 9, 30, 210, -90), (5, 8, 30, None, None), (6, 8, 36, None, None),
    (8, 9, 44, None, None), (6, 11, 34, -235, 100),
]


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
        "defect-variety": round(chance.uniform(0, 1), 2), "vignetting": round(chance.uniform(0.05, 0.35), 2),
        "bad-columns": chance.choice([0, 1, 1, 3]), "strand-jitter-rad": round(chance.uniform(0.02, 0.05), 3),
    }
    return lays + [word for key, value in chosen.items() for word in (f"--{key}", str(value))]


def run(*words):
    subprocess.run([str(word) for word in words], check=True, capture_output=True)
