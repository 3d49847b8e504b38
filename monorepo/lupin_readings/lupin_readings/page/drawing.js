// Draws elements. A drawing is in units of 1/16 of the page's font size, which grows with the window.
const UNITS_PER_REM = 16;
const pen = document.createElement('canvas').getContext('2d');
pen.font = '11px system-ui, sans-serif';  // the font of all drawings
export const HALF_TEXT = 4;  // from the middle of a number to its baseline
export const width_of = text => pen.measureText(text).width;

// Appends an element of HTML or SVG, whichever the parent is, with the texts or elements in it.
export function mark(parent, name, attributes = {}, ...children) {
  const space = name === 'svg' ? 'http://www.w3.org/2000/svg' : parent.namespaceURI;
  const child = parent.appendChild(document.createElementNS(space, name));
  for (const [key, value] of Object.entries(attributes)) child.setAttribute(key, value);
  child.append(...children);
  return child;
}

export const rem = units => `${units / UNITS_PER_REM}rem`;

// Returns the size of an element in units.
export function size_of(place) {
  const { width, height } = place.getBoundingClientRect();
  const unit = parseFloat(getComputedStyle(document.documentElement).fontSize) / UNITS_PER_REM;
  return [width / unit, height / unit];
}

export function start_drawing(parent, width, height, more) {
  parent.replaceChildren();
  return mark(parent, 'svg', { width: rem(width), height: rem(height), viewBox: `0 0 ${width} ${height}`, ...more });
}

// Returns the point that is nearest to an event, or null if none is nearer than `farthest`.
export function nearest(points, svg, event, farthest) {
  const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  const distance = p => Math.hypot(p.x - x, p.y - y);
  return points.reduce((best, p) => distance(p) < (best ? distance(best) : farthest) ? p : best, null);
}

// Writes texts with dots between them. No line begins or ends with a dot.
export function write_pieces(place, texts, is_bad = () => false) {
  place.replaceChildren();
  place.classList.toggle('pieces', texts.length > 0);
  texts.forEach((text, number) => {
    const piece = mark(place, 'span');
    mark(piece, 'i', {}, number ? ' · ' : '');
    mark(piece, 'span', { class: is_bad(number) ? 'bad' : '' }, text);
  });
}

export const write = (svg, x, y, text, anchor, name = 'muted') =>
  mark(svg, 'text', { class: name, x, y, 'text-anchor': anchor }, text);
export const path_of = points =>
  `M${points.map(point => point.map(coordinate => coordinate.toFixed(1)).join()).join('L')}`;
export const cross_at = (x, y, arm) =>
  `M${x - arm} ${y - arm}l${2 * arm} ${2 * arm}m${-2 * arm} 0l${2 * arm} ${-2 * arm}`;
export const filled = fill => ({ fill, style: `--value: ${fill}` });
