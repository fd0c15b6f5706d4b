// Returns a scan for tests, as text: a hill of side×side points, 6 by 6 units, with intensities and two classes.
export function hill(side) {
  const lines = ['x y z intensity classification'];
  for (let i = 0; i < side; i += 1) {
    for (let j = 0; j < side; j += 1) {
      const [x, y] = [i * 6 / side, j * 6 / side];
      lines.push(`${x.toFixed(3)} ${y.toFixed(3)} ${(Math.sin(1.3 * x) * 0.4 + Math.cos(0.9 * y) * 0.5).toFixed(4)} ${i * j} ${x < 1.8 ? 2 : 5}`);
    }
  }
  return lines.join('\n');
}
