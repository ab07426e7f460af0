"""How the page looks: colours of its widgets by day and by night, what is in focus, and names for those who listen."""

#: The page's own colours, by day and by night.
COLOURS = """
:root { --paper: #fff; --ink: #1a1a1a; --line: #ccc; --warning: #a03000; --accent: #0072B2;
  --background-color: var(--paper); --color: var(--ink); --border-color: var(--line); }
@media (prefers-color-scheme: dark) {
  :root { --paper: #16181c; --ink: #e8e8e8; --line: #50545c; --warning: #ffb080; --accent: #56B4E9; }
}
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 15px/1.45 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 1.25rem; margin: 0.2rem 0 0; overflow-wrap: anywhere; }
.verdict { font-weight: 600; font-size: 1.1rem; }
"""

#: Of every widget: the page's own colours, which are inherited, and an outline round what the keyboard is at.
WIDGETS = """
:host { color: var(--ink); }
.bk-input, .bk-btn { background: var(--paper); color: var(--ink); border-color: var(--line); }
.bk-btn:hover { border-color: var(--accent); }
select:not([multiple]).bk-input { background-image: url("data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' \
viewBox='0 0 8 8'%3E%3Cpath fill='%23808080' d='M0 2h8L4 7z'/%3E%3C/svg%3E"); background-size: 8px; }
.bk-slider-title { overflow-wrap: anywhere; white-space: normal; }
.noUi-target { background: var(--line); }
.bk-input:focus-visible, .bk-btn:focus-visible, .noUi-handle:focus-visible {
  outline: 3px solid var(--accent); outline-offset: 2px; }
"""

#: Colours of the pictures after those of the page, now and when they change; names of the sliders' handles.
LOOKS = """
const night = matchMedia('(prefers-color-scheme: dark)');
const doc = Bokeh.documents[0];
const find = (node, test, found = []) => {
  if (node.matches && test(node)) found.push(node);
  if (node.shadowRoot) for (const child of node.shadowRoot.children) find(child, test, found);
  for (const child of node.children || []) find(child, test, found);
  return found;
};
const paint = () => {
  const [paper, ink, line] = night.matches ? ['#16181c', '#e8e8e8', '#50545c'] : ['#ffffff', '#1a1a1a', '#e5e5e5'];
  for (const plot of doc.roots().filter((root) => root.renderers)) {
    plot.background_fill_color = paper;
    plot.border_fill_color = paper;
    plot.outline_line_color = line;
    plot.title.text_color = ink;
    const parts = ['left', 'right', 'above', 'below', 'center'].flatMap((side) => plot[side]);
    for (const part of parts) {
      if (part.type === 'Grid') part.grid_line_color = line;
      if (part.type === 'Legend') { part.label_text_color = ink; part.background_fill_color = paper; }
      if (part.axis_label_text_color !== undefined) {
        part.axis_label_text_color = part.major_label_text_color = ink;
        part.axis_line_color = part.major_tick_line_color = part.minor_tick_line_color = ink;
      }
    }
    for (const renderer of plot.renderers) {
      // The blue of print is dim on dark paper; the lighter one of the house is not.
      const held = renderer.glyph.line_color?.value?.toLowerCase?.();
      if (['#0072b2', '#56b4e9'].includes(held)) {
        renderer.glyph.line_color = {value: night.matches ? '#56B4E9' : '#0072B2'};
      }
      const dark = renderer.glyph.tags?.includes('ink') || renderer.tags?.includes('ink');
      if (dark) { renderer.glyph.line_color = {value: ink}; renderer.glyph.fill_color = {value: ink}; }
    }
  }
};
const name = (roots) => {
  for (const root of roots) {
    const place = document.querySelector(`[data-root-id="${root.id}"]`);
    for (const handle of find(place, (node) => node.matches('.noUi-handle'))) {
      handle.setAttribute('aria-label', root.title);
      handle.setAttribute('aria-valuetext', `${root.title} ${+root.value.toPrecision(6)}`);
    }
    const parts = root.renderers ? find(place, (node) => node.tabIndex === 0) : [];
    for (const part of parts) {
      part.setAttribute('role', part.title ? 'button' : 'img');
      part.style.setProperty('--highlight-color', 'var(--accent)'); // of its outline
      part.setAttribute('aria-label', `${part.title || 'Picture'}: ${root.title.text}`);
    }
  }
};
night.addEventListener('change', paint);
paint();
setTimeout(() => name(doc.roots()), 0);
for (const root of doc.roots()) {
  const said = root.renderers ? root.title.properties.text : root.start !== undefined && root.properties.value;
  if (said) said.change.connect(() => setTimeout(() => name([root]), 0));
}
"""
