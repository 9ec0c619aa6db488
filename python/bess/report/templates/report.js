"use strict";
(function () {
  const coarse = window.matchMedia("(pointer: coarse)").matches;
  // A finger that scrolls must not zoom.
  const still = (key, value) => (coarse && key === "active_drag" ? null : value);

  // If the interactive figure fails, the still picture is shown again.
  async function draw(chart) {
    const figure = chart.closest("figure");
    figure.classList.add("drawn");
    try {
      const item = JSON.parse(chart.nextElementSibling.textContent, still);
      const views = await Bokeh.embed.embed_item(item, chart.id);
      const models = views.roots[0].model.document.all_models;
      for (const button of figure.querySelectorAll(".legend button")) {
        button.addEventListener("click", () => toggle(models, button));
      }
    } catch (error) {
      figure.classList.remove("drawn");
      console.error(error);
    }
  }

  function toggle(models, button) {
    const shown = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(shown));
    for (const model of models) {
      if (model.name === button.dataset.label) model.visible = shown;
    }
  }

  // Figures are drawn when they come into view.
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

  // Print folded sections as well.
  window.addEventListener("beforeprint", function () {
    for (const folded of document.querySelectorAll("details")) folded.open = true;
  });
})();
