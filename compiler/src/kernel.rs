//! What goes into a kernel and what comes out.

/// Inputs of a kernel, one entry per interaction; the three slices have one length.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Current measures l, a or v in m, m^2, m^3.
    pub measure: &'a [f64],
    /// Reference measures L, A or V > 0.
    pub reference: &'a [f64],
    /// Relative changes `(l - L)/L`, computed from displacements.
    pub change: &'a [f64],
}

/// Outputs of a kernel, one entry per interaction.
#[derive(Clone, Debug, Default)]
pub struct Derivatives {
    /// The energy density.
    pub psi: Vec<f64>,
    /// Its derivative with respect to the measure.
    pub dpsi: Vec<f64>,
    /// Its second derivative with respect to the measure.
    pub d2psi: Vec<f64>,
}

impl Derivatives {
    /// Makes room for `n` interactions.
    pub fn resize(&mut self, n: usize) {
        self.psi.resize(n, 0.0);
        self.dpsi.resize(n, 0.0);
        self.d2psi.resize(n, 0.0);
    }
}
