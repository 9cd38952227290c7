"""Surfaces that transmit, at typical and at extreme parameters."""

CASES = {
    "thin_sheet": "thin_sheet(rho=[0.3, 0.1], tau=0.4, rho_behind=0.2)",
    "rough_slab": "rough_slab(alpha=0.1, alpha_behind=0.3, clear=[0.9, 0.5])",
    "rough_slab opaque": "rough_slab(alpha=0.5, alpha_behind=0.5, eta=4, clear=[0, 0.3])",
    "rough_slab narrow": "rough_slab(alpha=0.001, alpha_behind=0.001, eta=1.01, clear=[1, 0.5])",
    "cosine_power_transmission": "cosine_power_transmission(tau=[0.8, 0.4], n=30)",
    "cosine_power_transmission flat": "cosine_power_transmission(tau=1, n=0)",
    "transmitted": "transmitted(base=beckmann(alpha=0.2))",
    "transmitted sum": "transmitted(base=lambert(rho=0.3) + 0.5 * ggx(alpha_x=0.02, alpha_y=0.4))",
    "rough_dielectric": "rough_dielectric(alpha=0.3, eta=1.5)",
    "rough_dielectric narrow": "rough_dielectric(alpha=0.001, eta=[1.5, 1.52])",
    "rough_dielectric rarer": "rough_dielectric(alpha_x=0.1, alpha_y=0.6, eta=0.67, smith=separable)",
    "rough_dielectric beckmann": "rough_dielectric(alpha=1, eta=1.000001, distribution=beckmann)",
}
