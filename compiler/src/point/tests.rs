use super::verify_gradient;
use crate::test_support::{model, values};

const ST_VENANT: &str = "potential svk
parameter lambda = 3
parameter mu = 2
E = (F'*F - I)/2
psi(F) = lambda/2*tr(E)^2 + mu*(E : E)";

const NEO_HOOKE: &str = "potential nh
parameter lambda = 100
parameter mu = 1
psi(F) = mu/2*(tr(C) - d - 2*ln(J)) + lambda/2*ln(J)^2";

const STABLE: &str = "potential stable
parameter lambda = 100
parameter mu = 1
alpha = 1 + mu/lambda
psi(F) = mu/2*(tr(C) - d) + lambda/2*(J - alpha)^2 - mu^2/lambda/2";

const MOONEY: &str = "potential mooney
dimensions 3
parameter c1 = 0.3
parameter c2 = 0.7
parameter K = 11
I1 = J^(-2/3)*tr(C)
I2 = J^(-4/3)*(tr(C)^2 - C : C)/2
psi(F) = c1*(I1 - 3) + c2*(I2 - 3) + K/2*(J - 1)^2";

const FUNG: &str = "potential fung
parameter c = 2
parameter b = 3
Q = b*(E : E)
psi(F) = c/2*(exp(Q) - 1) + tr(E)^2";

const FIBRE: &str = "potential fibre
dimensions 3
parameter k = 3
I4 = I + C
stretch = tr(dev(sym(I4))*C)
psi(F) = E : E + (if stretch > 0 then k*stretch^2 else 0)";

#[test]
fn energies_of_the_gradient_have_right_digits_near_rest_and_far_from_it() {
    for text in [ST_VENANT, NEO_HOOKE, STABLE, MOONEY, FUNG, FIBRE] {
        let model = model(text);
        for dimension in model.dimensions() {
            let values = values(&model, dimension, &[]);
            let found = verify_gradient(&model, &values, 24).unwrap().unwrap();
            println!("{} {dimension} {found:?}", model.name());
            assert!(found.passed(), "{} in {dimension} dimensions: {found:?}", model.name());
        }
    }
}
