// Matrices of four by four, column by column, as in WebGL.

export const identity = () => new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);

/** Returns the matrix product left × right: the right matrix is applied first. */
export function multiplied(a, b) {
  const c = new Float32Array(16);
  for (let column = 0; column < 4; column += 1) {
    for (let row = 0; row < 4; row += 1) {
      for (let k = 0; k < 4; k += 1) c[4 * column + row] += a[4 * k + row] * b[4 * column + k];
    }
  }
  return c;
}

export function shifted(x, y, z) {
  const made = identity();
  made.set([x, y, z], 12);
  return made;
}

/** Returns a rotation by an angle, radians, about the axis with this index. */
export function rotated(axis, angle) {
  const made = identity();
  const [i, j] = [(axis + 1) % 3, (axis + 2) % 3];
  made[5 * i] = made[5 * j] = Math.cos(angle);
  made[4 * i + j] = Math.sin(angle);
  made[4 * j + i] = -Math.sin(angle);
  return made;
}

export function perspective(angle, aspect, near, far) {
  const f = 1 / Math.tan(angle / 2);
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
}
