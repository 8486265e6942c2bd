//! Energies of what points gather from their families, a field `s_i` of some numbers at every point.
//!
//! | module | gathers |
//! |---|---|
//! | [`deformation`] | deformation gradients, `H_i = sum_j (u_j - u_i) x G_ij`: correspondence peridynamics |
//! | [`vectors`] | integrals of vectors and functions of them, whatever a potential writes: shape tensors, gradients |
//! | [`states`] | integrals of the lengths of bonds, `I_i = sum_j V_j g(l_ij, L_ij)`: ordinary state-based peridynamics |
//!
//! [`least_squares`] has deformation gradients for bodies whose energies know none.
//!
//! All go one way: displacements give the fields, laws at points and at bonds give energies with their
//! derivatives by the fields and by the displacements of bonds, and the transpose of the first map takes
//! the former to forces. To first order the first map is `ds_i = sum_j G_ij (du_j - du_i)` for all, and
//! what follows from that is worked out once: `stored` makes the Hessian and its diagonal from the weights
//! `G` and from second derivatives by the fields, `springs` fills the matrix that products are
//! preconditioned by. `lost` knows which bonds families have lost, `judged` asks conditions of
//! places, `remembered` changes what points remember.

pub mod deformation;
mod judged;
pub mod least_squares;
mod lost;
mod remembered;
pub(crate) mod springs;
pub mod states;
pub(crate) mod stored;
pub mod vectors;
