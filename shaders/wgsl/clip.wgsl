// Clip curves and lines as linear forms (rendering model §7). Twin: surfel-math, clip.rs, which also makes the forms.

// Orthogonal map from the coordinates (u', v') on a filtered footprint, whose half-axes a filter has turned, to the
// splat's own (u, v), in which its clip is stated.
struct Turn {
    // The (u, v) of (u', v') = (1, 0), and the (u, v) of (0, 1).
    first: vec2f,
    second: vec2f,
}

// Clip of a splat as linear forms: over the splat's (u, v), or over pixel offsets after `clip_through`. The forms of
// the curve are its chord and the two other sides of its control triangle P1 P2 P3. They are scaled so that the curve
// is chord² = side1·side3. Up to four lines follow.
struct Clip {
    chord: Linear,
    side1: Linear,
    side3: Linear,
    // 1 if the clip keeps the inside of the curve, −1 if it keeps the outside.
    curve_sign: f32,
    // Lines, multiplied by line_sign. Absent lines are positive everywhere.
    lines: array<Linear, 4>,
    // 1 if a point has to be inside every line, −1 if a single line suffices.
    line_sign: f32,
}

// Returns the identity.
fn turn_none() -> Turn {
    return Turn(vec2f(1.0, 0.0), vec2f(0.0, 1.0));
}

// Returns the (u, v) that a turn maps the (u', v') `p` to.
fn turn_apply(turn: Turn, p: vec2f) -> vec2f {
    return turn.first * p.x + turn.second * p.y;
}

// Returns the map that applies `inner` first, then `outer`.
fn turn_after(outer: Turn, inner: Turn) -> Turn {
    return Turn(turn_apply(outer, inner.first), turn_apply(outer, inner.second));
}

// Returns a clip's form over (u, v) as a form over pixel offsets, see `clip_through`.
fn form_through(form: Linear, footprint: Footprint, turn: Turn) -> Linear {
    let gradient = vec2f(form.x, form.y);
    let u = v2_dot(gradient, turn.first);
    let v = v2_dot(gradient, turn.second);
    return Linear(
        fma(footprint.u.c, u, fma(footprint.v.c, v, footprint.w.c * form.c)),
        fma(footprint.u.x, u, fma(footprint.v.x, v, footprint.w.x * form.c)),
        fma(footprint.u.y, u, fma(footprint.v.y, v, footprint.w.y * form.c)),
    );
}

// Returns a clip over (u, v) as forms over pixel offsets from the footprint's anchor. `turn` maps the footprint's (u',
// v') to the clip's (u, v). The values of the forms are multiplied by the footprint's w, so their signs are those over
// (u, v) where w > 0.
fn clip_through(clip: Clip, footprint: Footprint, turn: Turn) -> Clip {
    return Clip(
        form_through(clip.chord, footprint, turn),
        form_through(clip.side1, footprint, turn),
        form_through(clip.side3, footprint, turn),
        clip.curve_sign,
        array<Linear, 4>(
            form_through(clip.lines[0], footprint, turn),
            form_through(clip.lines[1], footprint, turn),
            form_through(clip.lines[2], footprint, turn),
            form_through(clip.lines[3], footprint, turn),
        ),
        clip.line_sign,
    );
}

// True if the clip's curve keeps the point at pixel offset d from the footprint's anchor.
fn clip_curve_keeps(clip: Clip, d: vec2f) -> bool {
    let chord = linear_at(clip.chord, d);
    let side1 = linear_at(clip.side1, d);
    let side3 = linear_at(clip.side3, d);
    // It suffices to compare the square with the product. If the comparison is true, side3 has the sign of side1.
    let inside = chord <= 0.0 || (0.0 <= side1 && chord * chord <= side1 * side3);
    return inside != (clip.curve_sign < 0.0);
}

// True if the clip's lines keep the point at pixel offset d from the footprint's anchor.
fn clip_lines_keep(clip: Clip, d: vec2f) -> bool {
    let a = min(linear_at(clip.lines[0], d), linear_at(clip.lines[1], d));
    let b = min(linear_at(clip.lines[2], d), linear_at(clip.lines[3], d));
    // At least one line is ≥ 0 exactly if the minimum of their negatives is ≤ 0.
    return 0.0 <= min(a, b) * clip.line_sign;
}

// True if both the curve and the lines of a clip keep the point at pixel offset d from the footprint's anchor.
fn clip_keeps(clip: Clip, d: vec2f) -> bool {
    return clip_curve_keeps(clip, d) && clip_lines_keep(clip, d);
}
