"use strict";
(function () {
  const coarse = window.matchMedia("(pointer: coarse)").matches;
  const settings = {
    responsive: true,
    displayModeBar: false,
  };

  // The still picture stays until the interactive one is complete, and comes back if it fails.
  function draw(chart) {
    const figure = chart.closest("figure");
    const spec = JSON.parse(chart.nextElementSibling.textContent);
    // A finger that scrolls must not zoom.
    if (coarse) spec.layout.dragmode = false;
    figure.classList.add("drawn");
    Plotly.newPlot(chart, spec.data, spec.layout, settings).catch(function (error) {
      figure.classList.remove("drawn");
      console.error(error);
    });
  }

  // A page of many figures draws those that come into view.
  const seen = new IntersectionObserver(function (entries) {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      seen.unobserve(entry.target);
      draw(entry.target.querySelector(".chart"));
    }
  }, { rootMargin: "600px" });
  for (const chart of document.querySelectorAll(".chart")) seen.observe(chart.closest("figure"));

  for (const link of document.querySelectorAll(".save")) {
    link.href = link.closest("figure").querySelector(".still img").src;
  }
})();
