/**
 * The camera of `gash render`: it looks at the middle of the bounding box from a distance at which the ball of half the
 * box's diagonal fills 28 degrees. What turning and zooming change is the direction it stands in, and the frame: middle
 * and half width of the picture on the plane at distance 1.
 */

export const VIEWS = { front: [0, 8], side: [90, 8], back: [180, 8], top: [0, 65], below: [0, -35] };

const DISTANCE = 1 / Math.sin((14 * Math.PI) / 180);
const MARGIN = 1.06;
const [NEAR, FAR] = [DISTANCE - 3, DISTANCE + 3];
const STEEP = 89;

export class Camera {
  constructor() {
    this.azimuth = 0;
    this.elevation = 8;
    this.box = { center: [0, 0, 0], size: 1 };
    this.middle = [0, 0];
    this.half = 0.3;
  }

  /** Look from a direction at all of the vertices, which fill the frame. */
  frame(azimuth, elevation, vertices, used) {
    [this.azimuth, this.elevation] = [azimuth, elevation];
    this.box = bounds(vertices, used);
    const { eye, axes } = this.pose();
    const low = [Infinity, Infinity];
    const high = [-Infinity, -Infinity];
    for (const vertex of used) {
      const seen = this.seen(vertices, 3 * vertex, eye, axes);
      for (let i = 0; i < 2; i++) {
        low[i] = Math.min(low[i], seen[i] / seen[2]);
        high[i] = Math.max(high[i], seen[i] / seen[2]);
      }
    }
    this.middle = [0, 1].map((i) => (low[i] + high[i]) / 2);
    this.half = (Math.max(high[0] - low[0], high[1] - low[1], 1e-6) / 2) * MARGIN;
  }

  /** Eye in units of the box, and rows right, up, forward. */
  pose() {
    const [azimuth, elevation] = [this.azimuth, this.elevation].map((degrees) => (degrees * Math.PI) / 180);
    const [s, c] = [Math.sin(azimuth), Math.cos(azimuth)];
    const [up, flat] = [Math.sin(elevation), Math.cos(elevation)];
    const eye = [s * flat, up, c * flat].map((value) => value * DISTANCE);
    const axes = [
      [c, 0, -s],
      [-s * up, flat, -c * up],
      [-s * flat, -up, -c * flat],
    ];
    return { eye, axes };
  }

  seen(vertices, at, eye, axes) {
    const { center, size } = this.box;
    const apart = [0, 1, 2].map((i) => (vertices[at + i] - center[i]) / size - eye[i]);
    return axes.map((axis) => axis[0] * apart[0] + axis[1] * apart[1] + axis[2] * apart[2]);
  }

  turn(right, up) {
    this.azimuth = ((((this.azimuth - right + 180) % 360) + 360) % 360) - 180;
    this.elevation = Math.max(-STEEP, Math.min(STEEP, this.elevation + up));
  }

  /** Zoom about a point of the picture, whose sides run from -1 to 1. */
  zoom(factor, [x, y] = [0, 0], aspect = 1) {
    const half = Math.max(1e-4, Math.min(1.5, this.half * factor));
    const [wide, high] = sides(aspect);
    this.middle[0] += x * wide * (this.half - half);
    this.middle[1] += y * high * (this.half - half);
    this.half = half;
  }

  /** Move what is seen by shares of the picture's half width and height. */
  pan(x, y, aspect) {
    const [wide, high] = sides(aspect);
    this.middle[0] -= x * wide * this.half;
    this.middle[1] -= y * high * this.half;
  }

  /** Matrix (column by column) from positions to clip space, and the eye among the positions. */
  clip(aspect) {
    const { eye, axes } = this.pose();
    const { center, size } = this.box;
    const [wide, high] = sides(aspect).map((side) => side * this.half);
    const place = axes.map((axis) => -axis.reduce((sum, value, i) => sum + value * (center[i] / size + eye[i]), 0));
    const row = (i) => [...axes[i].map((value) => value / size), place[i]];
    const [right, up, forward] = [row(0), row(1), row(2)];
    const depth = (FAR + NEAR) / (FAR - NEAR);
    const rows = [
      right.map((value, i) => (value - this.middle[0] * forward[i]) / wide),
      up.map((value, i) => (value - this.middle[1] * forward[i]) / high),
      forward.map((value, i) => depth * value - (i === 3 ? (2 * FAR * NEAR) / (FAR - NEAR) : 0)),
      forward,
    ];
    return {
      matrix: rows[0].flatMap((_, i) => rows.map((values) => values[i])),
      eye: eye.map((e, i) => center[i] + size * e),
    };
  }

  /** Middle and half sides of the picture on the plane at distance 1. */
  window(aspect) {
    return [...this.middle, ...sides(aspect).map((side) => side * this.half)];
  }

  /** Unnormalised direction that a point of the picture, from -1 to 1, looks in. */
  ray(x, y, aspect) {
    const { axes } = this.pose();
    const [right, up, wide, high] = this.window(aspect);
    const plane = [right + x * wide, up + y * high, 1];
    return [0, 1, 2].map((i) => plane.reduce((sum, value, j) => sum + value * axes[j][i], 0));
  }
}

/** Half width and height of the picture in units of the shorter one. */
function sides(aspect) {
  return [Math.max(aspect, 1), Math.max(1 / aspect, 1)];
}

/** Middle of the bounding box of some vertices, and half its diagonal. */
export function bounds(vertices, used) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (const vertex of used) {
    for (let i = 0; i < 3; i++) {
      low[i] = Math.min(low[i], vertices[3 * vertex + i]);
      high[i] = Math.max(high[i], vertices[3 * vertex + i]);
    }
  }
  const center = low.map((value, i) => (value + high[i]) / 2);
  return { center, size: Math.hypot(...low.map((value, i) => high[i] - value)) / 2 || 1 };
}
