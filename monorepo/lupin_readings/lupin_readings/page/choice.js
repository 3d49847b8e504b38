// The chosen tag, which is marked in the map, the table and the charts.
import { address, data, element, facts_of, placed_tags } from './data.js';
import { write_pieces } from './drawing.js';

const chosen_tag = () => data.tags.find(({ id }) => [address(id), `#tag=${id}`].includes(location.hash));

export function choose(tag) {
  if (tag) location.hash = address(tag.id);
  else history.replaceState(null, '', location.pathname);
  show_chosen();
}

// Chooses a tag so many places after the one that has the focus, and focuses it.
export function choose_next(step) {
  const here = placed_tags.findIndex(tag => tag.id === document.activeElement.dataset.tag);
  choose(placed_tags[(here + step + placed_tags.length) % placed_tags.length]);
  document.querySelector('#map a.chosen')?.focus();
}

export function show_chosen() {
  const tag = chosen_tag(), focused = document.activeElement;
  write_pieces(element('facts'), tag ? facts_of(tag) : []);
  for (const each of document.querySelectorAll('[data-tag]')) {
    const is_chosen = each.dataset.tag === tag?.id;
    each.classList.toggle('chosen', is_chosen);
    each.ariaCurrent = is_chosen ? 'true' : null;
    if (is_chosen && each.localName !== 'tr' && each.nextSibling) each.parentNode.append(each);  // above the others
  }
  const dots = [...document.querySelectorAll('#map a')];
  const current = dots.find(dot => dot.dataset.tag === tag?.id) ?? dots[0];
  for (const dot of dots) dot.setAttribute('tabindex', dot === current ? 0 : -1);
  if (dots.includes(focused)) focused.focus({ preventScroll: true });  // it was moved
}
