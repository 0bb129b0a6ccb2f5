// The compositing rule "weighted": in any order, splats with weights w_i make a pixel's colour
// Σ c_i α_i w_i / Σ α_i w_i, which covers some of the background. α is cut as by the rule "sum".
import sum

section forward
import weighted, weighted.coverage
// What a pixel has gathered so far: weighted colours, the transmittance Π (1 - α_i), and weights.
struct Gathered {
    rgb: vec3f,
    a: f32,
    weight: f32,
}

fn nothing_yet(inside: bool) -> Gathered {
    return Gathered(vec3f(), select(0.0, 1.0, inside), 0.0);
}

fn with_splat(gathered: Gathered, alpha: f32, colour: vec3f, weight: f32) -> Gathered {
    let amount = alpha * weight;
    return Gathered(gathered.rgb + amount * colour, gathered.a - alpha * gathered.a, gathered.weight + amount);
}

// Whether a pixel takes more splats.
fn takes_more(gathered: Gathered) -> bool {
    return true;
}

// The finished pixel: colour over the background, and how much of that shows.
fn composited(gathered: Gathered) -> vec4f {
    var pixel = vec4f(view.background.rgb, 1.0);
    if (gathered.weight > 0.0) {
        let covered = coverage(gathered.a, gathered.weight);
        pixel = mix(pixel, vec4f(gathered.rgb / gathered.weight, 0.0), covered);
    }
    return pixel;
}

section by_transmittance
// As much as in a sorted image.
fn coverage(transmittance: f32, weight: f32) -> f32 {
    return 1.0 - transmittance;
}

section against_background
import weights.shared
// The background takes part with a weight of its own (Hou et al. 2024).
@group(0) @binding(7) var<uniform> weighting: Weighting;

fn coverage(transmittance: f32, weight: f32) -> f32 {
    return weight / (weight + weighting.background);
}
