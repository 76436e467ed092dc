extern crate std;
use std::println;
use std::vec::Vec;

use super::rendered::{Random, Scene, fine_image, image};
use super::*;

const METHODS: [Refinement; 3] =
    [Refinement::GradientOrthogonality, Refinement::Saddle, Refinement::ModelFit];

fn stats(scene: &Scene, radius: usize, method: Refinement, n: usize) -> (f64, f64, f64, usize) {
    let picture = scene.render();
    let mut random = Random(1);
    let (mut s, mut s2, mut sig, mut k, mut fail) = ([0.0; 2], 0.0, 0.0, 0, 0);
    for _ in 0..n {
        let pixels = picture.sampled(2.0, &mut random);
        let seed = CornerSeed {
            position_px: [0, 1].map(|i| scene.position_px[i] + random.uniform() - 0.5),
            ..scene.seed(radius)
        };
        match refine(&image(&pixels), &seed, method) {
            Ok(c) => {
                for i in 0..2 {
                    let e = c.position_px[i] - scene.position_px[i];
                    s[i] += e;
                    s2 += e * e;
                }
                sig += c.sigma_px * c.sigma_px;
                k += 1;
            }
            Err(_) => fail += 1,
        }
    }
    let k = k as f64;
    let m = [s[0] / k, s[1] / k];
    let var = s2 / k - m[0] * m[0] - m[1] * m[1];
    (libm::sqrt(var / 2.0), libm::hypot(m[0], m[1]), libm::sqrt(sig / k), fail)
}

#[test]
#[ignore]
fn experiment_sd() {
    for radius in 3..=8 {
        for blur in [0.5, 0.7, 1.0, 1.5] {
            for (name, base) in [("axis", 0), ("20deg", 1), ("tilt60", 2)] {
                let scene = Scene::new([31.3, 31.8], if base == 1 { 0.35 } else { 0.0 }, blur);
                let scene = if base == 2 { scene.tilted(1.0472, 0.2) } else { scene };
                std::print!("r{radius} blur{blur} {name:7}");
                for method in METHODS {
                    let (sd, bias, sigma, fail) = stats(&scene, radius, method, 200);
                    std::print!(" | {sd:.4} b{bias:.4} s{:.2} f{fail}", sigma / sd);
                }
                println!();
            }
        }
    }
}

#[test]
#[ignore]
fn experiment_bias() {
    for radius in [3, 6] {
        for blur in [0.4, 0.5, 0.7, 1.0, 1.5] {
            for (name, base) in [("axis", 0), ("20deg", 1), ("tilt60", 2), ("tilt60d", 3)] {
                let mut worst = [0.0_f64; 3];
                let mut fails = 0;
                for px in 0..6 {
                    for py in 0..6 {
                        let p = [31.0 + px as f64 / 6.0 + 0.03, 31.0 + py as f64 / 6.0 + 0.07];
                        let scene = Scene::new(p, if base == 1 { 0.35 } else { 0.0 }, blur);
                        let scene = match base {
                            2 => scene.tilted(1.0472, 0.2),
                            3 => scene.tilted(1.0472, 0.785),
                            _ => scene,
                        };
                        let fine = scene.render().fine();
                        for (m, method) in METHODS.into_iter().enumerate() {
                            match refine(&fine_image(&fine), &scene.seed(radius), method) {
                                Ok(c) => {
                                    let e = libm::hypot(
                                        c.position_px[0] - p[0],
                                        c.position_px[1] - p[1],
                                    );
                                    worst[m] = worst[m].max(e);
                                }
                                Err(e) => {
                                    if m == 2 && fails == 0 {
                                        println!("{e:?}");
                                    }
                                    fails += 1
                                }
                            }
                        }
                    }
                }
                println!("r{radius} blur{blur} {name:7} {worst:.5?} fails {fails}");
            }
        }
    }
}
