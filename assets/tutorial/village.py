"""Writes an airborne scan of a village that doesn't exist: points as text, with colours, intensities and classes.

    python3 assets/tutorial/village.py > assets/generated/village.txt

The positions are those of a map in metres (UTM zone 33 north), the classes those of LAS 1.4: 2 ground,
5 high vegetation, 6 building, 7 noise, 9 water. Python's standard library is enough, and every run writes the same
bytes.
"""

import math
import random

EAST, NORTH, SIDE, DENSITY = 412000.0, 5654000.0, 120.0, 16.0
LEVEL = 181.0  # metres above sea level, of the brook

rng = random.Random(7)


def ground(x, y):
    """Height of the ground, and its class and colour."""
    brook = 24 + 7 * math.sin(y / 19)
    road = 62 + 5 * math.sin(y / 31)
    bank = abs(x - brook)
    hills = 3.2 * math.sin(x / 27 + 0.6) * math.cos(y / 33) + 0.7 * math.sin(x / 7 + y / 9)
    slope = min(1.0, max(0.0, (bank - 3.0) / 22))
    z = LEVEL + 1.2 * min(1.0, max(0.0, bank - 3.2)) + (5.0 + hills) * slope * slope * (3 - 2 * slope)
    if bank < 3.2:
        return LEVEL + 0.02 * math.sin(x * 3 + y * 5), 9, (58, 96, 128)
    if abs(x - road) < 2.6:
        return z - 0.15, 2, (128, 124, 120)
    meadow = 0.5 + 0.5 * math.sin(x / 11) * math.sin(y / 13)
    return z, 2, (96 + int(42 * meadow), 128 + int(18 * meadow), 66 + int(14 * meadow))


def house_places():
    for row in range(5):
        for side, offset in ((-1, 11.5), (1, 12.5)):
            y = 13 + 23.5 * row + (5 if side > 0 else 0)
            yield 62 + 5 * math.sin(y / 31) + side * offset, y, rng.uniform(-0.25, 0.25)


HOUSES = []
for cx, cy, turn in house_places():
    HOUSES.append({
        "place": (cx, cy), "turn": turn, "half": (rng.uniform(4.2, 5.4), rng.uniform(5.4, 7.4)),
        "eaves": ground(cx, cy)[0] + rng.uniform(4.2, 5.6), "pitch": rng.uniform(0.55, 0.8),
        "color": rng.choice([(168, 84, 62), (150, 72, 58), (112, 108, 112), (176, 104, 70)]),
    })

TREES = []
while len(TREES) < 46:
    x, y = rng.uniform(3, SIDE - 3), rng.uniform(3, SIDE - 3)
    clear = all(math.dist((x, y), house["place"]) > 11 for house in HOUSES)
    if clear and abs(x - 62 - 5 * math.sin(y / 31)) > 6 and abs(x - 24 - 7 * math.sin(y / 19)) > 4.5:
        TREES.append((x, y, rng.uniform(2.2, 4.0), rng.uniform(6.5, 12.5), rng.uniform(0.8, 1.15)))


def roof(x, y):
    """Height and colour of the roof over a place, or None."""
    for house in HOUSES:
        dx, dy = x - house["place"][0], y - house["place"][1]
        u = dx * math.cos(house["turn"]) + dy * math.sin(house["turn"])
        v = dy * math.cos(house["turn"]) - dx * math.sin(house["turn"])
        if abs(u) <= house["half"][0] and abs(v) <= house["half"][1]:
            return house["eaves"] + (house["half"][0] - abs(u)) * house["pitch"], house["color"]
    return None


def row(x, y, z, color, intensity, kind, noise=0.02):
    shade = rng.uniform(0.9, 1.1)
    red, green, blue = (min(255, max(0, round(channel * shade))) for channel in color)
    print(f"{EAST + x:.2f} {NORTH + y:.2f} {z + rng.gauss(0, noise):.2f} {red} {green} {blue} "
          f"{round(intensity * rng.uniform(0.85, 1.15))} {kind}")


print("x y z red green blue intensity classification")
for _ in range(round(SIDE * SIDE * DENSITY)):
    x, y = rng.uniform(0, SIDE), rng.uniform(0, SIDE)
    over = roof(x, y)
    if over:
        row(x, y, over[0], over[1], 90, 6)
        continue
    z, kind, color = ground(x, y)
    if kind == 9 and rng.random() < 0.5:
        continue  # Water swallows half of the pulses.
    row(x, y, z, color, {9: 12, 2: 60}[kind] + (30 if color == (128, 124, 120) else 0), kind)
for x, y, radius, height, tint in TREES:
    base = ground(x, y)[0]
    for _ in range(round(150 * radius * radius)):
        # Pulses end in the outer leaves of a crown, mostly from above.
        angle, up = rng.uniform(0, 2 * math.pi), 1 - 1.6 * rng.random() ** 1.6
        reach = radius * math.sqrt(max(0.0, 1 - up * up)) * rng.uniform(0.75, 1.0)
        z = base + height - radius * 1.2 + up * radius * 1.2 * rng.uniform(0.8, 1.0)
        row(x + reach * math.cos(angle), y + reach * math.sin(angle), z,
            (70 * tint, 104 * tint, 48 * tint), 35, 5, noise=0.08)
for house in HOUSES:
    (half_u, half_v), (cos, sin) = house["half"], (math.cos(house["turn"]), math.sin(house["turn"]))
    foot = ground(*house["place"])[0] - 1.5
    for _ in range(round((half_u + half_v) * 4 * 6 * 14)):
        # Walls: pulses that come in at a slant.
        along, side = rng.uniform(-1, 1), rng.choice((-1, 1))
        gable = rng.random() < half_u / (half_u + half_v)
        u, v = (along * half_u * 0.94, side * half_v * 0.95) if gable else (side * half_u * 0.94, along * half_v * 0.95)
        top = house["eaves"] + (half_u - abs(u)) * house["pitch"]
        x, y = house["place"][0] + u * cos - v * sin, house["place"][1] + u * sin + v * cos
        z = rng.uniform(foot, top - 0.15)
        if z > ground(x, y)[0]:
            row(x, y, z, (208, 198, 178), 70, 6)
for _ in range(12):
    row(rng.uniform(0, SIDE), rng.uniform(0, SIDE), LEVEL + rng.uniform(30, 60), (200, 200, 200), 5, 7)
