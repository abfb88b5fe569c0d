// Renders each formula once its page is there, also after a page change that does not reload the site. KaTeX is loaded
// where there is a formula, and only there.
const katexFolder = new URL(".", document.currentScript.src);
let katexLoaded = null;

function loadKatex(name) {
  return new Promise((done, failed) => {
    const script = document.createElement("script");
    script.src = new URL(name, katexFolder);
    script.async = false; // in the order in which they are added
    script.onload = done;
    script.onerror = failed;
    document.head.append(script);
  });
}

document$.subscribe(({ body }) => {
  if (!body.querySelector(".arithmatex")) return;
  katexLoaded ??= Promise.all(["katex.min.js", "auto-render.min.js"].map(loadKatex));
  katexLoaded.then(() =>
    renderMathInElement(body, {
      delimiters: [
        { left: "\\(", right: "\\)", display: false },
        { left: "\\[", right: "\\]", display: true },
      ],
      throwOnError: true,
    }),
  );
});
