// The compositing rule: sorted "over". A contribution covers α of what is behind it.
import appearance.kind

// α where the exponent (to base 2) and the transmittance in front let it be drawn, else 0.
fn alpha_at(exponent: f32, transmittance: f32) -> f32 {
    let drawn = exponent >= LOG2_ALPHA_MIN && transmittance >= TRANSMITTANCE_MIN;
    return select(0.0, opacity_at(exponent), drawn);
}
