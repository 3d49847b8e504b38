// Places each label beside its dot, where it covers nothing and belongs clearly to this dot.
import { clamp } from './data.js';
import { mark, write } from './drawing.js';

export const TEXT_HEIGHT = 13, SPACE = 8;  // of a label, and between it and what is beside it
const BASELINE = 3;  // of a text, above the bottom of its box
const LINE_OVERLAP = 4;  // by which labels on neighbouring lines may come closer than SPACE
const ASIDE_OF_DOT = 4, ABOVE_DOT = 1;  // between a dot and its label, at its side and above it
const RING_ASIDE = 12, RING_ABOVE = 11;  // between the rings of places around a dot
const MOST_RINGS = 8;  // but only one in a crowd
const CROWD = 200;  // boxes near a dot, or labels
const CLEAR = 12;  // from a label to the ring of another tag, if possible
const LEADER_STEP = 3, LEADER_WIDTH = 2;  // of the boxes along the line from a dot to its label
const SHORTEST_LEADER = 10, LEADER_GAP = 3;  // of this line, and between it and the label
const MOST_COVERED = 1;  // a label that covers more is hidden
const SLANTS = [[0.5, -1], [1, 0.75], [1, 0.4]];  // places in shares of the distance aside and above
const STRAIGHT = 4;  // places beside, above and below the dot, which come before the slanting ones
const PLAN_WEIGHTS = [1, 5, 25];  // of three plans, one after the other

// What a place costs: for each unit of area that the label covers there,
const COST_OF_AREA = { taken: 99, route: 9, planned: 25 };
// and in areas of the label; `hidden` is a number by itself, above all others.
const COST = {
  hidden: 9999,
  ring: 0.2,  // of each ring farther away
  misread: 0.8,  // nearer to another dot
  at_stop: 0.35,  // nearer to a stop of the route
  close: 0.1,  // close to the ring of another tag
  slanting: 0.1,
  later: 0.005,  // of each place that comes before it
};

// Boxes are [left, top, right, bottom].
export const around = (x, y, width, height) => [x - width / 2, y - height / 2, x + width / 2, y + height / 2];
const shared = (low, high, other_low, other_high) =>
  Math.max(Math.min(high, other_high) - Math.max(low, other_low), 0);
const common = (a, b) => shared(a[0], a[2], b[0], b[2]) * shared(a[1], a[3], b[1], b[3]);
const with_space = ([left, top, right, bottom]) =>
  [left - SPACE, top + LINE_OVERLAP, right + SPACE, bottom - LINE_OVERLAP];
const boxes_of = ({ box, leader }) => [box, ...leader];
const covered_by = (place, boxes) =>
  boxes_of(place).reduce((sum, box) => boxes.reduce((more, other) => more + common(box, other), sum), 0);

// Returns the places around a dot in one ring, as distances from it: straight ones first.
function places_in(aside, above, slants) {
  const mirrored = ([x, y]) => [[x, y], [-x, y], [x, -y], [-x, -y]];
  const places = [[1, 0], [-1, 0], [0, -1], [0, 1], ...slants.flatMap(mirrored)];
  return places.map(([x, y]) => [x * aside, y * above]);
}

// Returns the best place of a label: its box, the boxes along its line to the dot, how much both cover, and
// whether it needs this line to be clear. A label is { x, y, radius, width } of its dot and its text;
// with an empty `pad` at both ends of the text; `beside` is what a place at the side costs more.
// It must not cover what is `taken`, and lies in the `room`. If it must, it crosses the `route`, is nearer to another
// of the `dots`, and lies where other labels are planned. `more` are further slanting places.
export function place_label(label, { taken, room, route, dots = [], more = [], plans }, weight = COST_OF_AREA.planned) {
  const { x, y, radius, width, pad = 0, beside = 0 } = label, area = width * TEXT_HEIGHT;
  const aside = radius + width / 2 + ASIDE_OF_DOT, above = radius + TEXT_HEIGHT / 2 + ABOVE_DOT;
  const reach = around(
    x, y, 2 * (aside + RING_ASIDE * MOST_RINGS) + width, 2 * (above + RING_ABOVE * MOST_RINGS + TEXT_HEIGHT),
  );
  const is_near = box => common(reach, box) > 0;
  const near = {
    taken: taken.filter(is_near),
    route: route.filter(is_near),
    planned: [...plans?.values() ?? []].flatMap(plan => [...boxes_of(plan), with_space(plan.box)]).filter(is_near),
    dots: dots.filter(dot => is_near(around(dot.x, dot.y, 1, 1)) && (dot.x !== x || dot.y !== y)),
  };
  const gap = ([left, top, right, bottom], dot) =>
    Math.hypot(clamp(dot.x, left + pad, right - pad) - dot.x, clamp(dot.y, top, bottom) - dot.y);
  const rings = near.taken.length > CROWD ? 1 : MOST_RINGS;
  let best = { cost: Infinity };
  for (let ring = 0; ring < rings && best.cost > COST.ring * ring * area; ring++) {
    const places = places_in(aside + RING_ASIDE * ring, above + RING_ABOVE * ring, [...more, ...SLANTS]);
    places.forEach(([dx, dy], number) => {
      const box = around(x + dx, y + dy, width, TEXT_HEIGHT);
      const place = { box, leader: ring ? leader_to(x, y, radius + SPACE, box) : [] };
      const covered = area - common(box, room) + covered_by(place, near.taken);
      const nearer = near.dots.filter(dot => gap(box, dot) < gap(box, { x, y })), is_misread = nearer.length > 0;
      const cost = COST.hidden * (covered > MOST_COVERED)
        + COST_OF_AREA.taken * covered
        + COST_OF_AREA.route * covered_by(place, near.route)
        + weight * covered_by(place, near.planned)
        + area * COST.ring * ring
        + area * COST.misread * is_misread
        + area * COST.at_stop * nearer.some(dot => !dot.outer)
        + area * COST.close * near.dots.some(dot => gap(box, dot) < dot.outer + CLEAR)
        + area * COST.slanting * (number >= STRAIGHT)
        + area * COST.later * number
        + area * beside * (dy === 0);
      if (cost < best.cost) best = { ...place, cost, covered, has_leader: ring > 0 || is_misread };
    });
  }
  return best;
}

// Returns small boxes along the line from a dot to its label, without those on the dot.
export function leader_to(x, y, radius, [left, top, right, bottom]) {
  const dx = clamp(x, left, right) - x, dy = clamp(y, top, bottom) - y, length = Math.hypot(dx, dy);
  const steps = { length: Math.max(Math.floor((length - radius) / LEADER_STEP), 0) };
  return Array.from(steps, (_, n) => 1 - (n + 1) * LEADER_STEP / length)
    .map(share => around(x + share * dx, y + share * dy, LEADER_WIDTH, LEADER_WIDTH));
}

export const write_in = (parent, [left, , right, bottom], name, text = '') =>
  write(parent, (left + right) / 2, bottom - BASELINE, text, 'middle', name);
export const draw_leader = (parent, x1, y1, x2, y2) =>
  parent.prepend(mark(parent, 'line', { class: 'leader', x1, y1, x2, y2 }));

// Plans the places of labels several times, so that a label gives way to one that has fewer places.
export function plan_labels(labels, surroundings) {
  surroundings.plans = new Map();
  for (const weight of labels.length > CROWD ? [] : PLAN_WEIGHTS) {
    for (const label of labels) {
      surroundings.plans.delete(label);
      surroundings.plans.set(label, place_label(label, surroundings, weight));
    }
  }
}

// Labels a dot, and returns its text. A label without a free place is shown if its tag is chosen.
export function label_dot(group, label, surroundings, name, text) {
  surroundings.plans.delete(label);
  const place = place_label(label, surroundings), { box, has_leader } = place;
  const is_spare = place.covered > MOST_COVERED;
  if (!is_spare) {
    surroundings.taken.push(...boxes_of(place));
    surroundings.route.push(with_space(box));  // no other label, if it can
    if (has_leader) draw_leader_of(group, label, box);
  }
  return write_in(group, box, is_spare ? `${name} spare` : name, text);
}

// Draws the line from a dot to its label, if it is long enough to be seen.
function draw_leader_of(group, { x, y, radius }, [left, top, right, bottom]) {
  const dx = clamp(x, left, right) - x, dy = clamp(y, top, bottom) - y, length = Math.hypot(dx, dy);
  const share = 1 - LEADER_GAP / length;
  if (share * length - radius >= SHORTEST_LEADER) draw_leader(group, x, y, x + share * dx, y + share * dy);
}
