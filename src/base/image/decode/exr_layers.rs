//! Which channels of an OpenEXR file are the picture: Nuke, Arnold, V-Ray and Blender name layers in the names of channels, and files of
//! several parts name parts. This module must not know pixels.

use exr::meta::header::Header;

/// A layer's red, green and blue; of a grey one its luminance in place of each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct LayerChannels {
    /// Index of the part.
    pub part: usize,
    /// What it is called; empty where neither the part nor its channels have a name.
    pub name: String,
    /// Indices of its channels in the part.
    pub channels: [usize; 3],
}

/// Names of layers in a message, at most.
const MAX_NAMES: usize = 12;

/// The layer of that name or, without one, the only layer or that without a name. The error says what there is.
pub(super) fn choose(headers: &[Header], wanted: Option<&str>) -> Result<LayerChannels, String> {
    let layers = layers(headers);
    if layers.is_empty() {
        return Err(no_layer(headers));
    }
    let known = || listed(layers.iter().map(|layer| layer.name.as_str()).filter(|name| !name.is_empty()));
    if let Some(wanted) = wanted {
        let is_last_part = |name: &str| name.rsplit('.').next().is_some_and(|last| last.eq_ignore_ascii_case(wanted));
        let exact = layers.iter().find(|layer| layer.name.eq_ignore_ascii_case(wanted));
        let mut by_last_part = layers.iter().filter(|layer| is_last_part(&layer.name));
        return match (exact, by_last_part.next(), by_last_part.next()) {
            (Some(layer), ..) | (None, Some(layer), None) => Ok(layer.clone()),
            _ if layers.iter().all(|layer| layer.name.is_empty()) => {
                Err(format!("has no layer '{wanted}': its channels have no layers; leave out #{wanted}"))
            }
            _ => Err(format!("has no layer '{wanted}'; it has {}", known())),
        };
    }
    match layers.as_slice() {
        [only] => Ok(only.clone()),
        several => several
            .iter()
            .find(|layer| layer.name.is_empty())
            .cloned()
            .ok_or_else(|| format!("has several layers: {}; name one, as in FILE.exr#{}", known(), several[0].name)),
    }
}

/// The layers with colours or, if there are none, those with a luminance alone.
fn layers(headers: &[Header]) -> Vec<LayerChannels> {
    let of_channels = |names: &[[&str; 2]; 3]| -> Vec<LayerChannels> {
        let of_part = |(part, header): (usize, &Header)| {
            let groups = groups(header);
            let of_group = |(prefix, channels): &(String, Vec<(String, usize)>)| {
                let is = |name: &str, of: &[&str; 2]| of.iter().any(|known| name.eq_ignore_ascii_case(known));
                let find = |of: &[&str; 2]| channels.iter().find(|(name, _)| is(name, of)).map(|(_, index)| *index);
                // Of a vector, Y is a coordinate; beside chroma, it is no grey.
                let is_other = names[0][0] == "Y"
                    && channels
                        .iter()
                        .any(|(name, _)| ["X", "Z", "RY", "BY"].iter().any(|k| name.eq_ignore_ascii_case(k)));
                let [Some(r), Some(g), Some(b)] = [0, 1, 2].map(|k| find(&names[k])) else { return None };
                (!is_other).then(|| LayerChannels { part, name: name_of(headers, part, prefix), channels: [r, g, b] })
            };
            groups.iter().filter_map(of_group).collect::<Vec<_>>()
        };
        headers.iter().enumerate().filter(|(_, header)| !header.deep).flat_map(of_part).collect()
    };
    let coloured = of_channels(&[["R", "red"], ["G", "green"], ["B", "blue"]]);
    if coloured.is_empty() { of_channels(&[["Y", "Y"]; 3]) } else { coloured }
}

/// Channels by what stands before the last dot of their names, in the file's order: their last parts and their indices.
fn groups(header: &Header) -> Vec<(String, Vec<(String, usize)>)> {
    let mut groups: Vec<(String, Vec<(String, usize)>)> = Vec::new();
    for (index, channel) in header.channels.list.iter().enumerate() {
        let name = channel.name.to_string();
        let (prefix, last) = name.rsplit_once('.').unwrap_or(("", &name));
        let channel = (last.to_owned(), index);
        match groups.iter_mut().find(|(known, _)| known == prefix) {
            Some((_, channels)) => channels.push(channel),
            None => groups.push((prefix.to_owned(), vec![channel])),
        }
    }
    groups
}

/// What a layer is called: its part, if there are several, and what its channels begin with, unless that repeats the part.
fn name_of(headers: &[Header], part: usize, prefix: &str) -> String {
    let of_part = headers[part].own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
    if headers.len() == 1 || of_part.is_empty() || prefix == of_part || prefix.starts_with(&format!("{of_part}.")) {
        return prefix.to_owned();
    }
    if prefix.is_empty() { of_part } else { format!("{of_part}.{prefix}") }
}

/// Why there is no layer.
fn no_layer(headers: &[Header]) -> String {
    let names: Vec<String> =
        headers.iter().flat_map(|header| header.channels.list.iter().map(|channel| channel.name.to_string())).collect();
    let is_chroma = |name: &String| matches!(name.rsplit('.').next(), Some("RY" | "BY"));
    if names.iter().any(is_chroma) {
        return "has luminance and chroma (channels Y, RY and BY); convert it to R, G and B".into();
    }
    let names = listed(names.iter().map(String::as_str));
    format!("has neither the channels R, G and B nor Y, only {names}; export it with them")
}

/// Names in a message.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<String> = names.map(crate::words::escaped).collect();
    let shown = names[..names.len().min(MAX_NAMES)].join(", ");
    if names.len() > MAX_NAMES { format!("{shown} and {} more", names.len() - MAX_NAMES) } else { shown }
}
