//! Checked requests of one call, read by blocks and cooling.

#[derive(Debug, Clone, Copy)]
pub(crate) struct Schedule<'a> {
    /// Control steps.
    pub(crate) steps: usize,
    /// Plant steps in each of them.
    pub(crate) substeps: usize,
    pub(crate) lanes: usize,
    pub(crate) strings: usize,
    pub(crate) request_w: &'a [f64],
    pub(crate) ambient_c: &'a [f64],
    /// Where reactive power is asked.
    pub(crate) reactive_var: Option<&'a [f64]>,
}

impl Schedule<'_> {
    #[inline]
    pub(crate) fn request_w(&self, step: usize, lane: usize) -> f64 {
        self.request_w[step * self.lanes + lane]
    }

    #[inline]
    pub(crate) fn reactive_var(&self, step: usize, lane: usize) -> f64 {
        self.reactive_var.map_or(0.0, |values| values[step * self.lanes + lane])
    }

    #[inline]
    pub(crate) fn ambient_c(&self, step: usize, lane: usize) -> f64 {
        self.ambient_c[step * (self.lanes / self.strings) + lane / self.strings]
    }
}
