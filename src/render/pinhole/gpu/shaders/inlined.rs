//! Sizes of pipelines once a driver has inlined all functions, as Mesa does: a user waits for these to be compiled before the first frame.

use naga::valid::Capabilities;
use naga::{Block, Function, Module, Statement};

use super::tests::{ALL, parse_with};
use super::{RayMethod, Variant};
use crate::pinhole::gpu::LightKind;

/// The most expressions and statements of an entry point with all that it calls, once for each call. Mesa 22 takes about a second to compile
/// the largest. A function that is called in several places can often be called in one, in a loop.
const MAX_SIZE: usize = 50_000;

#[test]
fn pipelines_are_small() {
    let sizes = sizes();
    let list: Vec<String> = sizes.iter().map(|(name, size)| format!("{size:8} {name}")).collect();
    println!("{}", list.join("\n"));
    assert!(sizes.iter().all(|(_, size)| *size <= MAX_SIZE), "above {MAX_SIZE}:\n{}", list.join("\n"));
}

/// All entry points by names, with the lights and media that their shader differs by.
fn sizes() -> Vec<(String, usize)> {
    let mut sizes = Vec::new();
    for shader in ALL {
        let mut last = String::new();
        for (light, medium) in
            [LightKind::Environment, LightKind::Lamp].into_iter().flat_map(|l| [(l, false), (l, true)])
        {
            let variant = Variant { rays: RayMethod::Traversal, light, medium };
            let source = shader.resolve(variant);
            if source == last {
                continue;
            }
            last = source;
            let module = parse_with(shader, variant, Capabilities::empty()).unwrap();
            for entry in &module.entry_points {
                let name = format!("{} {light:?}{}", entry.name, if medium { ", in a medium" } else { "" });
                sizes.push((name, inlined_size(&module, &entry.function)));
            }
        }
    }
    sizes
}

fn inlined_size(module: &Module, function: &Function) -> usize {
    function.expressions.len() + size_of_block(module, &function.body)
}

fn size_of_block(module: &Module, block: &Block) -> usize {
    block.iter().map(|statement| 1 + size_within(module, statement)).sum()
}

fn size_within(module: &Module, statement: &Statement) -> usize {
    match statement {
        Statement::Block(block) => size_of_block(module, block),
        Statement::If { accept, reject, .. } => size_of_block(module, accept) + size_of_block(module, reject),
        Statement::Switch { cases, .. } => cases.iter().map(|case| size_of_block(module, &case.body)).sum(),
        Statement::Loop { body, continuing, .. } => size_of_block(module, body) + size_of_block(module, continuing),
        Statement::Call { function, .. } => inlined_size(module, &module.functions[*function]),
        _ => 0,
    }
}
