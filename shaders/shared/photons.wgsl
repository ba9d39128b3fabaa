// Photons on receivers, and the account of their flux. CPU twins: src/render/image_space/photons.rs and ledger.rs; layout:
// src/render/image_space/gpu/layout.rs. The importing shader declares `ledger`.

#import constants
#import photon_surface
#import ray_origin
#import unit_vectors

struct Photon {
    // Metres.
    position: vec3f,
    // The receiver. NO_OBJECT: there is no photon.
    object: u32,
    // W.
    flux: vec3f,
    // The object that reflected or refracted it.
    caster: u32,
    // Packed unit vectors: the receiver's normal, and the direction of travel.
    normal: u32,
    direction: u32,
    // From the light to the first surface, 1/m; 0 from far away.
    inverse_before: f32,
    // From the last surface to the receiver, metres.
    beyond: f32,
}

// Where a photon was reflected or refracted.
struct PhotonWay {
    first: vec3f,
    // From the first surface to the last one, metres; 0 where they are the same.
    within: f32,
    // Towards the light.
    first_normal: vec3f,
    last: vec3f,
    last_normal: vec3f,
}

// Entries of the account, in the order of `Ledger`.
const CAST: u32 = 0u;
const DEPOSITED: u32 = 1u;
const MISSED: u32 = 2u;
const NOT_RECEIVED: u32 = 3u;
const TOTALLY_REFLECTED: u32 = 4u;
const HIDDEN: u32 = 5u;
const OFF_MAP: u32 = 6u;
const CULLED: u32 = 7u;
// Rays that the adapter ended early, and photons that met a receiver, in steps.
const UNFINISHED: u32 = 8u;
const LANDED: u32 = 9u;

// The sums of a workgroup: two words each.
var<workgroup> flux_account: array<atomic<u32>, 2u * LEDGER_ENTRIES>;

// A number of steps in two words.
struct Steps {
    low: u32,
    high: u32,
}

// Flux, or a component of flux times direction, in steps.
fn steps_of(watts: f32, steps_per_watt: f32) -> Steps {
    let steps = abs(watts) * steps_per_watt;
    let high = floor(steps * 2.3283064365386963e-10);
    let low = steps - high * 4294967296.0;
    let magnitude = Steps(u32(clamp(low, 0.0, 4294967040.0)), u32(min(high, 2147483520.0)));
    if watts >= 0.0 {
        return magnitude;
    }
    return Steps(~magnitude.low + 1u, ~magnitude.high + select(0u, 1u, magnitude.low == 0u));
}

// Adds flux, the sum of the channels, to an entry of this workgroup's account.
fn account_for(entry: u32, watts: f32, steps_per_watt: f32) {
    add_to_account(entry, steps_of(watts, steps_per_watt));
}

fn add_to_account(entry: u32, steps: Steps) {
    let before = atomicAdd(&flux_account[2u * entry], steps.low);
    let carry = select(0u, 1u, before > ~steps.low);
    atomicAdd(&flux_account[2u * entry + 1u], steps.high + carry);
}

// Adds the workgroup's account to the ledger. All invocations have to call this.
fn close_account(local_index: u32) {
    workgroupBarrier();
    if local_index < LEDGER_ENTRIES {
        let low = atomicLoad(&flux_account[2u * local_index]);
        let before = atomicAdd(&ledger[2u * local_index], low);
        let carry = select(0u, 1u, before > ~low);
        atomicAdd(&ledger[2u * local_index + 1u], atomicLoad(&flux_account[2u * local_index + 1u]) + carry);
    }
}

fn sum_of_channels(flux: vec3f) -> f32 {
    return flux.x + flux.y + flux.z;
}
