"use strict";
/* A part of a plot shown larger. What is shown is written into the area: fractions of it, from the left and from the top. */
const zoom = (() => {
  const whole = [0, 0, 1, 1];
  const view = (area) => area.dataset.view ? area.dataset.view.split(" ").map(Number) : whole;
  const box = (area) => ["x", "y", "width", "height"].map((name) => +area.getAttribute(name));
  /* The fractions of the whole plot at fractions of what is shown. */
  const at = (area, fx, fy) => {
    const [x, y, w, h] = view(area);
    return [x + fx * w, y + fy * h];
  };
  const areaOf = (element) => {
    const drawing = element instanceof Element ? element.closest("svg:has(> .area)") : null;
    return drawing ? drawing.querySelector(".area") : null;
  };

  const value = (axis, t) => axis.log ? axis.low * Math.pow(axis.high / axis.low, t) : axis.low + t * (axis.high - axis.low);
  const place = (axis, v) => axis.log ? Math.log(v / axis.low) / Math.log(axis.high / axis.low) : (v - axis.low) / (axis.high - axis.low);
  const axis = (area, name, from, to) => {
    const d = area.dataset;
    const all = { low: +d[`${name}0`], high: +d[`${name}1`], log: d[`${name}Spacing`] === "log" };
    return { low: value(all, from), high: value(all, to), log: all.log };
  };
  const power = (v) => [...String(Math.round(Math.log10(v)))].map((c) => c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]).join("");
  /* Round values, [value, label]. */
  const ticks = (axis, count) => {
    const ratio = axis.high / axis.low;
    if (axis.log && ratio > 3) {
      const found = [];
      const mantissas = ratio > 1000 ? [1] : ratio > 30 ? [1, 3] : [1, 2, 5];
      for (let e = Math.floor(Math.log10(axis.low)); e <= Math.log10(axis.high); e++) {
        for (const m of mantissas) {
          const v = m * Math.pow(10, e);
          if (v >= axis.low && v <= axis.high) found.push([v, m === 1 ? `10${power(v)}` : `${m}·10${power(Math.pow(10, e))}`]);
        }
      }
      return found;
    }
    const rough = (axis.high - axis.low) / count;
    const unit = Math.pow(10, Math.floor(Math.log10(rough)));
    const step = unit * ([1, 2, 2.5, 5].find((m) => m * unit >= rough) || 10);
    const decimals = Math.max(0, Math.ceil(-Math.log10(step) + (Math.abs(step / unit - 2.5) < 0.1 ? 1 : 0) - 1e-9));
    const label = (v) => {
      const largest = Math.max(Math.abs(axis.low), Math.abs(axis.high));
      if (largest < 1e5 && largest >= 1e-3) return v.toFixed(Math.min(12, decimals)).replace("-", "−");
      if (v === 0) return "0";
      // As many digits as a step shows.
      const exponent = Math.floor(Math.log10(Math.abs(v)) + 1e-9);
      const digits = Math.min(12, Math.max(0, exponent + (decimals || -Math.floor(Math.log10(step)))));
      return `${v < 0 ? "−" : ""}${(Math.abs(v) / Math.pow(10, exponent)).toFixed(digits)}·10${power(Math.pow(10, exponent))}`;
    };
    const found = [];
    for (let k = Math.ceil(axis.low / step - 1e-9); k * step <= axis.high + 1e-9 * step && found.length < 50; k++) found.push([k * step, label(k * step)]);
    return found;
  };
  const drawAxes = (area) => {
    const [x, y, w, h] = view(area);
    const [left, top, width, height] = box(area);
    const grid = [];
    const words = [];
    const lines = !area.dataset.image;
    const across = axis(area, "x", x, x + w);
    for (const [v, label] of ticks(across, width / 90)) {
      const px = left + place(across, v) * width;
      grid.push(`M${px} ${lines ? top : top + height}V${top + height + 5}`);
      words.push(`<text x="${px}" y="${top + height + 18}" text-anchor="middle" class="tick">${label}</text>`);
    }
    const up = axis(area, "y", 1 - y - h, 1 - y);
    for (const [v, label] of ticks(up, height / 50)) {
      const py = top + (1 - place(up, v)) * height;
      grid.push(`M${left - 5} ${py}H${lines ? left + width : left}`);
      // The margin was made for the labels of the whole plot; a digit is some 7 wide at 13.
      const size = Math.min(13, 13 * (left - 8) / (7 * label.length));
      words.push(`<text x="${left - 8}" y="${py + 4.5}" text-anchor="end" class="tick" style="font-size: ${size}px">${label}</text>`);
    }
    return `<path class="grid" d="${grid.join("")}"/>${words.join("")}`;
  };

  const show = (area, wanted) => {
    const limit = (v, low, high) => Math.min(high, Math.max(low, v));
    // At most a thousand times.
    const w = limit(wanted[2], 1e-3, 1), h = limit(wanted[3], 1e-3, 1);
    const next = [limit(wanted[0], 0, 1 - w), limit(wanted[1], 0, 1 - h), w, h];
    const all = w === 1 && h === 1;
    const drawing = area.parentElement;
    const inside = drawing.querySelector(":scope > .inside");
    const axes = drawing.querySelector(":scope > .axes");
    const [, , width, height] = box(area);
    drawing.querySelectorAll(":scope > .axes.now").forEach((group) => group.remove());
    axes.toggleAttribute("hidden", !all);
    if (all) delete area.dataset.view; else area.dataset.view = next.join(" ");
    inside.classList.toggle("zoomed", !all);
    inside.setAttribute("preserveAspectRatio", "none");
    inside.setAttribute("viewBox", `${next[0] * width} ${next[1] * height} ${w * width} ${h * height}`);
    // Marks and words keep their shape.
    for (const mark of inside.querySelectorAll("text, circle, .cross")) {
      const b = mark.getBBox();
      const [cx, cy] = mark.localName === "text" ? [+mark.getAttribute("x"), +mark.getAttribute("y")] : [b.x + b.width / 2, b.y + b.height / 2];
      mark.setAttribute("transform", `translate(${cx} ${cy}) scale(${w} ${h}) translate(${-cx} ${-cy})`);
    }
    if (all) return;
    const now = document.createElementNS("http://www.w3.org/2000/svg", "g");
    now.setAttribute("class", "axes now");
    now.innerHTML = drawAxes(area);
    axes.after(now);
  };
  /* Larger or smaller by a factor about a point, which stays where it is; fractions of what is shown. */
  const by = (area, factor, fx = 0.5, fy = 0.5) => {
    const [x, y, w, h] = view(area);
    const [nw, nh] = [Math.min(1, w / factor), Math.min(1, h / factor)];
    show(area, [x + fx * (w - nw), y + fy * (h - nh), nw, nh]);
  };

  /* A rectangle drawn with the mouse; one that is flat keeps the other axis. */
  let drag = null;
  const fraction = (area, event) => {
    const r = area.getBoundingClientRect();
    return [(event.clientX - r.left) / r.width, (event.clientY - r.top) / r.height].map((v) => Math.min(1, Math.max(0, v)));
  };
  const chosen = (event) => {
    const [a, b] = [drag.from, fraction(drag.area, event)];
    const r = drag.area.getBoundingClientRect();
    const far = [Math.abs(b[0] - a[0]) * r.width > 12, Math.abs(b[1] - a[1]) * r.height > 12];
    if (!far[0] && !far[1]) return null;
    const side = (k) => far[k] ? [Math.min(a[k], b[k]), Math.abs(b[k] - a[k])] : [0, 1];
    const [[x, w], [y, h]] = [side(0), side(1)];
    return [x, y, w, h];
  };
  document.addEventListener("pointerdown", (event) => {
    const area = event.target instanceof Element ? event.target.closest(".area") : null;
    if (!area || event.button !== 0 || event.pointerType === "touch") return;
    event.preventDefault();
    area.parentElement.focus({ preventScroll: true });
    const mark = document.createElementNS("http://www.w3.org/2000/svg", "rect");
    mark.setAttribute("class", "selection");
    area.before(mark);
    drag = { area, mark, from: fraction(area, event) };
  });
  document.addEventListener("pointermove", (event) => {
    if (!drag) return;
    const part = chosen(event);
    const [left, top, width, height] = box(drag.area);
    const [x, y, w, h] = part || [0, 0, 0, 0];
    Object.entries({ x: left + x * width, y: top + y * height, width: w * width, height: h * height })
      .forEach(([name, v]) => drag.mark.setAttribute(name, v));
  });
  addEventListener("pointerup", (event) => {
    if (!drag) return;
    const part = chosen(event);
    const area = drag.area;
    drag.mark.remove();
    if (part) {
      const [x, y, w, h] = view(area);
      show(area, [x + part[0] * w, y + part[1] * h, part[2] * w, part[3] * h]);
    }
    drag = null;
  });
  addEventListener("pointercancel", () => { if (drag) { drag.mark.remove(); drag = null; } });
  document.addEventListener("dblclick", (event) => {
    const area = event.target instanceof Element ? event.target.closest(".area") : null;
    if (area) show(area, whole);
  });

  return { at, by, view, areaOf, all: (area) => show(area, whole) };
})();
