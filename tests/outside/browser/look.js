// Looks at a page as it is laid out: every piece of text, where it is, and whether something is wrong with it.
(() => {
  const problems = [];
  const pieces = [];
  const told = (text) => JSON.stringify(text.length > 40 ? text.slice(0, 40) + "..." : text);
  const walker = document.createTreeWalker(document.body || document.documentElement, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode;
    const parent = node.parentElement;
    const text = node.textContent.trim();
    const closed = parent.closest("details:not([open])");
    if (closed && !parent.closest("summary")) continue; // not shown, but it has boxes
    if (!text || ["script", "style", "title"].includes(parent.tagName.toLowerCase())) continue;
    const svg = parent.ownerSVGElement;
    const range = document.createRange();
    range.selectNodeContents(node);
    const rects = svg ? [parent.getBoundingClientRect()] : [...range.getClientRects()];
    for (const rect of rects) if (rect.width > 0 && rect.height > 0) pieces.push({ text, rect, parent, svg });
  }
  const width = document.documentElement.clientWidth;
  if (document.documentElement.scrollWidth > width) {
    problems.push(`the page is ${document.documentElement.scrollWidth} px wide in a window of ${width}`);
  }
  for (const { text, rect, parent, svg } of pieces) {
    const frame = svg ? svg.getBoundingClientRect() : { left: 0, right: width, top: 0, bottom: Infinity };
    // a wide table or figure is moved sideways in its own frame, where a shadow shows that there is more
    const isMoved = parent.closest(".wide");
    const top = svg ? rect.top : 0;
    const isCut = rect.left < frame.left - 1 || rect.right > frame.right + 1 || top < frame.top - 1 ||
      (svg && rect.bottom > frame.bottom + 1);
    if (isCut && !isMoved) problems.push(`cut: ${told(text)}`);
    const size = parseFloat(getComputedStyle(parent).fontSize);
    const scale = svg && svg.viewBox.baseVal.width ? frame.right > frame.left ? (frame.right - frame.left) / svg.viewBox.baseVal.width : 1 : 1;
    if (size * scale < 9) problems.push(`too small, ${(size * scale).toFixed(1)} px: ${told(text)}`);
  }
  for (let i = 0; i < pieces.length; i++) {
    const a = pieces[i].rect;
    for (let j = i + 1; j < pieces.length; j++) {
      const b = pieces[j].rect;
      const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      // a letter's box is higher than the letter
      if (across > 1 && down > 3) problems.push(`over each other: ${told(pieces[i].text)} and ${told(pieces[j].text)}`);
    }
  }
  const empty = [...document.querySelectorAll("figure svg")].filter((svg) => {
    const marks = svg.querySelectorAll("circle, polygon, path, polyline");
    return [...marks].every((mark) => { const box = mark.getBBox(); return box.width + box.height === 0; });
  });
  if (empty.length) problems.push(`${empty.length} figures show nothing`);
  for (const element of document.querySelectorAll("main, section, .verdict, .first, .figures, figure, p, th, td")) {
    if (element.scrollWidth > element.clientWidth + 1 && !element.closest(".wide") && element.clientWidth > 0) {
      problems.push(`wider than its place: ${told(element.textContent)}`);
    }
  }
  const moved = [...document.querySelectorAll(".wide")].filter((wide) => wide.scrollWidth > wide.clientWidth + 1);
  for (const wide of moved) {
    if (!getComputedStyle(wide).backgroundImage.includes("gradient")) problems.push(`nothing shows that it scrolls: ${told(wide.textContent)}`);
  }
  const scrolled = moved.filter((wide) => wide.querySelector("table")).map((wide) => wide.closest("section, .verdict").textContent.slice(0, 40));
  const bottoms = [...document.querySelectorAll(".first table, .first figure")].map((part) => part.getBoundingClientRect().bottom);
  const first = Math.ceil(Math.max(0, ...bottoms));
  parent.postMessage(JSON.stringify({ width, height: document.documentElement.scrollHeight, texts: pieces.length, first, scrolled, problems }), "*");
})();
