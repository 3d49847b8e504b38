// The chosen tag. The map, the table and the charts mark it.
import { address, data, element, facts_of, placed_tags } from './data.js';
import { write_pieces } from './drawing.js';

const chosen_tag = () => data.tags.find(({ id }) => [address(id), `#tag=${id}`].includes(location.hash));

export function choose(tag) {
  if (tag) location.hash = address(tag.id);
  else history.replaceState(null, '', location.pathname);
  show_chosen();
}

// Moves the choice and the focus by a number of tags.
export function choose_next(step) {
  const here = placed_tags.findIndex(tag => tag.id === document.activeElement.dataset.tag);
  choose(placed_tags[(here + step + placed_tags.length) % placed_tags.length]);
  document.querySelector('#map a.chosen')?.focus();
}

export function show_chosen() {
  const tag = chosen_tag(), focused = document.activeElement;
  write_pieces(element('facts'), tag ? facts_of(tag) : []);
  for (const marked of document.querySelectorAll('[data-tag]')) {
    const is_chosen = marked.dataset.tag === tag?.id, is_row = marked.localName === 'tr';
    marked.classList.toggle('chosen', is_chosen);
    marked.ariaCurrent = is_chosen ? 'true' : null;
    if (is_chosen && !is_row && marked.nextSibling) marked.parentNode.append(marked);  // above the others
  }
  const dots = [...document.querySelectorAll('#map a')];
  const current = dots.find(dot => dot.dataset.tag === tag?.id) ?? dots[0];
  for (const dot of dots) dot.setAttribute('tabindex', dot === current ? 0 : -1);
  if (dots.includes(focused)) focused.focus({ preventScroll: true });  // it was moved
}
