//! The conformance test of filters on the adapter here.

use std::sync::OnceLock;

use pinspot::blocking::wait;
use pinspot::low_level::conformance::{Conformance, Device, FilterResult, Verdict, examine};
use pinspot::low_level::pinhole::Filter;

use crate::support::gpu;

fn result(conformance: &Conformance, filter: Filter, taps: u32) -> &FilterResult {
    conformance.results.iter().find(|r| r.filter == filter && r.taps == taps).unwrap()
}

/// The GPU's figures, which take minutes on a software adapter.
fn on_gpu() -> &'static Conformance {
    static MEASURED: OnceLock<Conformance> = OnceLock::new();
    MEASURED.get_or_init(|| wait(Some(&gpu().device), examine(Device::Gpu(gpu()), &|| ())).unwrap())
}

/// Pinspot's own filters do the same on both back ends and get better with their cost, everywhere on the cube.
#[test]
#[ignore = "full: takes minutes on a software adapter"]
fn the_shader_filters_are_as_good_as_they_claim() {
    let cpu = wait(None, examine(Device::Cpu, &|| ())).unwrap();
    let gpu = on_gpu();
    for own in &cpu.results {
        let twin = result(gpu, own.filter, own.taps);
        assert!(
            (own.rms_error - twin.rms_error).abs() < 1e-3,
            "{:?}: {} {}",
            own.filter,
            own.rms_error,
            twin.rms_error
        );
        assert!((own.fetches - twin.fetches).abs() < 0.01 * own.fetches, "{:?}", own.filter);
    }
    let order = [
        (Filter::None, 1),
        (Filter::Isotropic, 1),
        (Filter::Anisotropic, 4),
        (Filter::Anisotropic, 16),
        (Filter::Ewa, 1),
    ];
    for pair in order.windows(2) {
        let [worse, better] = [pair[0], pair[1]].map(|(filter, taps)| result(&cpu, filter, taps).rms_error);
        assert!(better < worse, "{pair:?}: {better} {worse}");
    }
    for (filter, taps) in [(Filter::Anisotropic, 16), (Filter::Ewa, 1)] {
        let result = result(&cpu, filter, taps);
        assert_eq!(result.verdict, Verdict::Right, "{result:?}");
        assert!(result.by_place.iter().all(|(_, error)| *error < 0.11), "seams and corners, too: {result:?}");
        assert!(result.orientation > 0.9 && result.orientation < 1.1, "{result:?}");
    }
    assert_eq!(result(&cpu, Filter::Isotropic, 1).verdict, Verdict::Approximate);
}

/// Software adapters ignore explicit gradients on cube maps; that must not go unnoticed. Whatever the adapter: the verdict is
/// what its figures say, the quick test that every render makes comes to the same one, and auto follows it.
#[test]
#[ignore = "full: takes minutes on a software adapter"]
fn the_hardware_filter_is_found_out() {
    let gpu = gpu();
    let conformance = on_gpu();
    let hardware = result(conformance, Filter::Hardware, 16);
    println!("{}: {hardware:?}", conformance.device);
    let quick = wait(Some(&gpu.device), pinspot::low_level::pinhole::gpu::check_hardware_filter(gpu)).unwrap();
    assert_eq!(quick.is_right(), hardware.verdict == Verdict::Right, "{quick:?} {hardware:?}");
    let seen_as_anisotropic = hardware.orientation > 0.9 && hardware.orientation < 1.1;
    match hardware.verdict {
        Verdict::Right => assert!(hardware.rms_error < 0.07 && seen_as_anisotropic, "{hardware:?}"),
        Verdict::Approximate => assert!(hardware.rms_error >= 0.07 && hardware.orientation >= 0.5, "{hardware:?}"),
        Verdict::WrongIgnoresGradients => assert!(hardware.orientation < 0.5, "{hardware:?}"),
    }
    // Round footprints ask nothing of the gradients' direction: whoever reads the gradients filters them as mips allow.
    let round = |result: &FilterResult| result.by_aspect.iter().find(|(aspect, _)| *aspect == 1.0).unwrap().1;
    let (own, isotropic) = (round(hardware), round(result(conformance, Filter::Isotropic, 1)));
    let ignores = hardware.verdict == Verdict::WrongIgnoresGradients;
    assert!(ignores || own < isotropic + 0.05, "round footprints: {own}, by mips alone {isotropic}");
    assert!(hardware.by_pattern.iter().all(|(_, error)| error.is_finite()), "{hardware:?}");
    if gpu.adapter.software {
        assert_eq!(hardware.verdict, Verdict::WrongIgnoresGradients, "{hardware:?}");
        assert!(hardware.rms_error > 0.2 && hardware.orientation.abs() < 0.2);
        assert_eq!(conformance.auto, Filter::Anisotropic);
    }
    assert_eq!(conformance.auto == Filter::Hardware, hardware.rms_error < 0.07, "auto follows the verdict");
}
