"""Surfaces that transmit, at typical and at extreme parameters."""

CASES = {
    "thin_sheet": "thin_sheet(rho=[0.3, 0.1], tau=0.4, rho_behind=0.2)",
    "rough_dielectric": "rough_dielectric(alpha=0.3, eta=1.5)",
    "rough_dielectric narrow": "rough_dielectric(alpha=0.001, eta=[1.5, 1.52])",
    "rough_dielectric rarer": "rough_dielectric(alpha_x=0.1, alpha_y=0.6, eta=0.67, smith=separable)",
    "rough_dielectric beckmann": "rough_dielectric(alpha=1, eta=1.000001, distribution=beckmann)",
}
