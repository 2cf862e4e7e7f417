'use strict';
// Reads values off a picture and zooms into it. Without this script the picture is as it is drawn.
for (const data of document.querySelectorAll('script.curves')) {
  explore(data.parentElement, JSON.parse(data.textContent));
}

function explore(figure, panels) {
  const plot = figure.querySelector('.plot');
  const canvas = plot.appendChild(document.createElement('canvas'));
  const output = figure.insertBefore(
    document.createElement('output'), figure.querySelector('figcaption'));
  const hint = 'Point at a curve to read it. Drag over a stretch to zoom, double-click to return.';
  const phone = matchMedia('screen and (max-width:40rem)');  // where the panels stand in one column
  let zoom = null, from = null, at = null;  // zoom: panel's x limits -> [low, high]
  const key = panel => JSON.stringify([panel.x, panel.xlog]);
  const to = (log, v) => (log ? Math.log10(v) : v), back = (log, v) => (log ? 10 ** v : v);
  const spot = panel => panel.places[phone.matches ? panel.places.length - 1 : 0];
  const limits = panel => (zoom && zoom.key === key(panel) ? zoom.range : panel.x);
  const colour = name => getComputedStyle(figure).getPropertyValue('--' + name) || name;

  function place(event) {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }
  function under([u, v]) {
    return panels.find(panel => {
      const [l, t, w, h] = spot(panel).box;
      return u >= l && u <= l + w && v >= t && v <= t + h;
    });
  }
  function value(panel, u) {
    const [low, high] = limits(panel).map(v => to(panel.xlog, v)), [left, , width] = spot(panel).box;
    return back(panel.xlog, low + (high - low) * Math.min(1, Math.max(0, (u - left) / width)));
  }
  function nearest(curve, x) {
    let best = 0;
    curve.x.forEach((v, k) => { if (Math.abs(v - x) < Math.abs(curve.x[best] - x)) best = k; });
    return best;
  }
  const said = v => String(Number(v.toPrecision(4))).replace('-', '\u2212');
  function shown(panel, curve, k) {  // three digits of the largest value, of each on a log axis
    const largest = panel.ylog ? curve.y[k] : Math.max(...curve.y.map(Math.abs));
    const places = Math.max(0, 2 - Math.floor(Math.log10(Math.abs(largest) || 1)));
    return said(Number(curve.y[k].toFixed(places)));
  }

  function read(panel, x) {
    output.textContent = `${panel.name} at ${said(x)}:`;
    for (const curve of panel.curves) {
      const part = output.appendChild(document.createElement('span'));
      part.style.color = colour(curve.colour);
      part.textContent = ` ${curve.name} ${shown(panel, curve, nearest(curve, x))}\u2003`;
    }
  }
  function draw() {
    const ratio = window.devicePixelRatio || 1, pen = canvas.getContext('2d');
    const W = canvas.clientWidth, H = canvas.clientHeight;
    canvas.width = W * ratio; canvas.height = H * ratio;
    pen.scale(ratio, ratio);
    pen.font = `${Math.max(9, W / 90)}px system-ui, sans-serif`;
    for (const panel of panels) {
      const [l, t, w, h] = spot(panel).box.map((share, k) => share * (k % 2 ? H : W));
      if (zoom && zoom.key === key(panel)) zoomed(pen, panel, l, t, w, h, W, H);
      if (at && at.key === key(panel)) {
        pen.fillStyle = colour('muted');
        const [a, b] = limits(panel).map(v => to(panel.xlog, v)), x = to(panel.xlog, at.x);
        pen.fillRect(l + w * (x - a) / (b - a), t, 1, h);
        if (from && from.panel === panel) {
          pen.globalAlpha = 0.2;
          const start = l + w * (to(panel.xlog, from.x) - a) / (b - a);
          pen.fillRect(start, t, l + w * (x - a) / (b - a) - start, h);
          pen.globalAlpha = 1;
        }
      }
    }
  }
  function zoomed(pen, panel, l, t, w, h, W, H) {
    const [low, high] = limits(panel), a = to(panel.xlog, low), b = to(panel.xlog, high);
    const seen = panel.curves.flatMap(c => c.y.filter((_, k) => c.x[k] >= low && c.x[k] <= high));
    if (!seen.length) return;
    let [c, d] = seen.reduce(([m, n], v) => [Math.min(m, v), Math.max(n, v)], [Infinity, -Infinity])
      .map(v => to(panel.ylog, v));
    const margin = 0.05 * (d - c) || 1; c -= margin; d += margin;
    const [left, top, right, bottom] = spot(panel).outer;
    pen.fillStyle = colour('page');
    pen.fillRect(left * W, top * H, (right - left) * W, (bottom - top) * H);
    const X = v => l + w * (to(panel.xlog, v) - a) / (b - a);
    const Y = v => t + h * (d - to(panel.ylog, v)) / (d - c);
    pen.strokeStyle = colour('rule'); pen.lineWidth = 0.8; pen.fillStyle = colour('ink');
    const line = (x, y, p, q) => {
      pen.beginPath(); pen.moveTo(x, y); pen.lineTo(p, q); pen.stroke();
    };
    pen.textAlign = 'center'; pen.textBaseline = 'top';
    for (const v of ticks(a, b, panel.xlog)) {
      line(X(v), t, X(v), t + h); pen.fillText(said(v), X(v), t + h + 4);
    }
    pen.textAlign = 'right'; pen.textBaseline = 'middle';
    for (const v of ticks(c, d, panel.ylog)) {
      line(l, Y(v), l + w, Y(v)); pen.fillText(said(v), l - 4, Y(v));
    }
    pen.textAlign = 'left'; pen.textBaseline = 'bottom';
    pen.fillText(panel.name, l + 4, t + 12);
    pen.textAlign = 'right';
    pen.fillText(panel.xname, l + w, t + h - 2);
    pen.save(); pen.beginPath(); pen.rect(l, t, w, h); pen.clip();
    for (const curve of panel.curves) {
      pen.strokeStyle = colour(curve.colour);
      pen.lineWidth = curve.width;
      pen.globalAlpha = curve.alpha;
      pen.setLineDash(curve.dashed ? [5, 3] : []);
      pen.beginPath();
      curve.x.forEach((v, k) => pen.lineTo(X(v), Y(curve.y[k])));
      pen.stroke();
    }
    pen.restore();
  }
  function ticks(low, high, log) {
    const rough = (high - low) / 5, unit = 10 ** Math.floor(Math.log10(rough)), found = [];
    const step = unit * [1, 2, 5, 10].find(s => s * unit >= 0.999 * rough);
    for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(back(log, k * step));
    return found;
  }
  function point(event) {
    const [u, v] = place(event), panel = from ? from.panel : under([u, v]);
    at = panel ? {key: key(panel), x: value(panel, u)} : null;
    if (panel) read(panel, at.x); else output.textContent = hint;
    draw();
  }
  canvas.addEventListener('pointermove', point);
  canvas.addEventListener('pointerdown', event => {
    point(event);
    const [u, v] = place(event), panel = under([u, v]);
    if (!panel || event.pointerType !== 'mouse') return;
    from = {panel, x: value(panel, u), u};
  });
  window.addEventListener('pointerup', event => {
    if (from && Math.abs(place(event)[0] - from.u) > 0.01) {
      const range = [from.x, value(from.panel, place(event)[0])].sort((p, q) => p - q);
      zoom = {key: key(from.panel), range};
    }
    if (from) { from = null; draw(); }
  });
  canvas.addEventListener('dblclick', () => { zoom = null; draw(); });
  canvas.addEventListener('pointerleave', () => { at = null; output.textContent = hint; draw(); });
  window.addEventListener('resize', draw);
  matchMedia('(prefers-color-scheme:dark)').addEventListener('change', draw);
  output.textContent = hint;
  draw();
}
