//! Follows photons from a light's view by rays: to the first surface that reflects or refracts them, and on to the receivers.
//!
//! A ray stands for the flux in one texel of the view. Where a surface both reflects and refracts, it goes on as both. Knows neither maps nor
//! cameras.

use glam::{DVec2, Vec2, Vec3};

use super::constants::MIN_DIRECT_COSINE;
use super::ledger::{Ledger, Loss};
use super::lights::LightView;
use super::photons::{Photon, PhotonGrid, SurfacePoint, Way};
use super::strips::Strip;
use super::surface_images::SurfaceImages;
use crate::lanes::{ALL, LANES};
use crate::parallel;
use crate::pinhole::constants::MIN_HEIGHT;
use crate::progress::Progress;
use crate::reflectance::Curve;
use crate::scene::{Chain, Chains, Interfaces, Object, Ray, Refractor, Sides};
use crate::stages::divided;
use crate::tracing::{Hit, Tracer};

/// What photons meet.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// Everything that light meets.
    pub tracer: &'a Tracer,
    /// The scene's objects.
    pub objects: &'a [Object],
    /// Their specular reflectance by angle of incidence.
    pub mirrors: &'a [Option<Curve>],
}

/// A kind of way: a chain and, where colours are refracted differently, one of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kind {
    /// The chain.
    pub chain: Chain,
    /// The channel of dispersed light.
    pub channel: Option<usize>,
}

impl Kind {
    /// All kinds of ways that the objects offer light of these chains.
    pub fn of_scene(objects: &[Object], chains: Chains) -> Vec<Self> {
        let solids = objects.iter().filter(|object| object.casts(Chain::TTTT)).count();
        let is_dispersive = objects.iter().any(|o| o.refractor.is_some_and(|refractor| refractor.is_dispersive()));
        let offered = |chain: &Chain| {
            let is_possible = *chain != Chain::TTTT || solids > 1;
            is_possible && chains.contains(*chain) && objects.iter().any(|object| object.casts(*chain))
        };
        let of_chain = |chain: Chain| {
            let is_divided = is_dispersive && chain != Chain::R;
            let channels = if is_divided { vec![Some(0), Some(1), Some(2)] } else { vec![None] };
            channels.into_iter().map(move |channel| Self { chain, channel })
        };
        Chain::ALL.into_iter().filter(offered).flat_map(of_chain).collect()
    }

    /// The index of a refractor for this light.
    fn eta(self, refractor: &Refractor) -> f64 {
        refractor.eta[self.channel.unwrap_or(0)]
    }

    /// The part of light that is of this kind.
    fn filtered(self, flux: Vec3) -> Vec3 {
        self.channel.map_or(flux, |channel| flux * Vec3::AXES[channel])
    }
}

/// A photon on its way after a surface.
struct Flight {
    ray: Ray,
    flux: Vec3,
    caster: u32,
    /// The closed object that it is in or has left last.
    solid: u32,
    way: Way,
}

/// What became of one photon.
#[derive(Clone, Copy, Debug, Default)]
pub struct Traced {
    /// On a receiver, if it met one.
    pub photon: Option<Photon>,
    /// The account of its flux, as far as it is not deposited.
    pub ledger: Ledger,
}

/// Rays from a light's view.
#[derive(Clone, Copy)]
pub struct Emission<'a> {
    /// What they meet.
    pub surroundings: &'a Surroundings<'a>,
    /// Where they find it, unless they are traced.
    pub images: Option<&'a SurfaceImages>,
    /// Where they start.
    pub view: &'a LightView,
    /// How they go through it.
    pub pattern: Pattern,
}

/// Which rays of a view photons go along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pattern {
    /// Origins in extended lights are drawn by it.
    pub seed: u64,
    /// Their places in the texels of the view.
    pub offset: DVec2,
    /// Flux is that of Wyman and Davis 2006, Equations 3 and 9.
    pub is_papers: bool,
}

/// Photons of every kind, one for each texel of a strip of the light's view, with the account of its own rows.
pub fn emit(emission: &Emission, kinds: &[Kind], strip: Strip, progress: &dyn Progress) -> (Vec<PhotonGrid>, Ledger) {
    let own = strip.first_own_row..strip.first_own_row + strip.own_rows;
    let rows: Vec<Row> = parallel::collect(strip.rows as usize, &|y| {
        if progress.is_cancelled() {
            return Row { photons: vec![Vec::new(); kinds.len()], ledger: Ledger::default() };
        }
        let row = emission.row(kinds, strip.first_row + y as u32);
        if own.contains(&(y as u32)) {
            progress.advance(1);
            return row;
        }
        Row { ledger: Ledger::default(), ..row }
    });
    let mut ledger = Ledger::default();
    let mut of_kinds: Vec<Vec<Vec<(u32, Photon)>>> = kinds.iter().map(|_| Vec::new()).collect();
    for row in rows {
        ledger += row.ledger;
        of_kinds.iter_mut().zip(row.photons).for_each(|(rows, photons)| rows.push(photons));
    }
    let width = emission.view.projection.size[0];
    (of_kinds.into_iter().map(|rows| PhotonGrid::new(width, strip, rows.into_iter())).collect(), ledger)
}

/// The photons of a row, by kind.
struct Row {
    photons: Vec<Vec<(u32, Photon)>>,
    ledger: Ledger,
}

impl Emission<'_> {
    fn row(&self, kinds: &[Kind], y: u32) -> Row {
        let mut row = Row { photons: vec![Vec::new(); kinds.len()], ledger: Ledger::default() };
        let width = self.view.projection.size[0];
        for first in (0..width).step_by(LANES) {
            let texels = std::array::from_fn(|lane| [first + lane as u32, y]);
            let lanes = ALL >> (LANES as u32 - (width - first).min(LANES as u32));
            self.trace(kinds, &texels, lanes, |kind, lane, traced| {
                row.ledger += traced.ledger;
                row.photons[kind].extend(traced.photon.map(|photon| (first + lane as u32, photon)));
            });
        }
        row
    }

    /// Follows a photon from each of sixteen texels of the view, in the lanes asked for. Calls with the number of the kind and the lane.
    pub fn trace(
        &self,
        kinds: &[Kind],
        texels: &[[u32; 2]; LANES],
        lanes: u32,
        mut call: impl FnMut(usize, usize, Traced),
    ) {
        let emitted: [(Ray, Vec3); LANES] = texels.map(|texel| self.ray(texel));
        let hits = self.first_hits(texels, &emitted.map(|(ray, _)| ray), lanes);
        for (k, kind) in kinds.iter().enumerate() {
            let flights = std::array::from_fn(|lane| self.scatter(*kind, hits[lane].as_ref()?, &emitted[lane]));
            let landed = self.follow(*kind, flights);
            landed.into_iter().enumerate().for_each(|(lane, traced)| call(k, lane, traced));
        }
    }

    fn ray(&self, [x, y]: [u32; 2]) -> (Ray, Vec3) {
        let place = DVec2::new(f64::from(x), f64::from(y)) + self.pattern.offset;
        let index = y.wrapping_mul(self.view.projection.size[0]).wrapping_add(x);
        let seed = (self.pattern.seed as u32).wrapping_add(index >> 16);
        let [u, v, ..] = sobol_burley::sample_4d(index & 0xffff, 0, seed);
        self.view.emit(place, Vec2::new(u, v))
    }

    /// What the first surface makes of a photon; `None` if that is nothing of this kind.
    fn scatter(&self, kind: Kind, hit: &Hit, (ray, flux): &(Ray, Vec3)) -> Option<Flight> {
        let object = &self.surroundings.objects[hit.object as usize];
        let (direction, factor) = match (object.reflector, &object.refractor, kind.chain) {
            (Some(reflector), _, Chain::R) => {
                let is_lit = match reflector.sides {
                    Sides::Both => true,
                    Sides::Front => hit.front,
                    Sides::Back => !hit.front,
                };
                let curve = self.surroundings.mirrors[hit.object as usize].as_ref().filter(|_| is_lit)?;
                let cosine = -ray.direction.dot(hit.normal);
                (reflected(ray.direction, hit), curve.at(f64::from(cosine)).as_vec3())
            }
            (_, Some(refractor), Chain::R) if hit.front && refractor.fresnel => {
                let reflectance = refractor.eta.to_array().map(|eta| divided(refractor, eta, (hit, ray)).0);
                (reflected(ray.direction, hit), Vec3::from(reflectance))
            }
            (_, Some(refractor), chain) if hit.front && passes(refractor, chain) => {
                let (reflectance, refracted) = divided(refractor, kind.eta(refractor), (hit, ray));
                (refracted?.direction, Vec3::splat(1.0 - reflectance))
            }
            _ => return None,
        };
        // A photon without flux still is a neighbour, unless nothing would pass.
        let is_passing = kind.filtered(factor) != Vec3::ZERO;
        let flux = kind.filtered(*flux * factor);
        let point = SurfacePoint { position: hit.position, normal: hit.normal };
        let before = if self.view.projection.is_parallel { f32::INFINITY } else { hit.distance };
        let way = Way { before, within: 0.0, beyond: 0.0, first: point, last: point };
        let ray = Ray { origin: hit.position, direction };
        is_passing.then_some(Flight { ray, flux, caster: hit.object, solid: hit.object, way })
    }

    /// Where photons land that have left the first surface.
    fn follow(&self, kind: Kind, mut flights: [Option<Flight>; LANES]) -> [Traced; LANES] {
        let mut traced = [Traced::default(); LANES];
        for (traced, flight) in traced.iter_mut().zip(&flights) {
            traced.ledger.cast = flight.as_ref().map_or(0.0, |flight| Ledger::sum(flight.flux));
        }
        if matches!(kind.chain, Chain::TT | Chain::TTTT) {
            self.leave_all(kind, &mut flights, &mut traced);
        }
        if kind.chain == Chain::TTTT {
            let hits = self.next_hits(&flights, |images, flight| images.entry(&flight.ray, flight.solid));
            for ((flight, hit), traced) in flights.iter_mut().zip(&hits).zip(&mut traced) {
                *flight = flight.take().and_then(|left| self.enter_another(kind, &left, hit.as_ref()?));
                // What does not get here is lost to light that is refracted twice.
                let cast = flight.as_ref().map_or(0.0, |flight| Ledger::sum(flight.flux));
                traced.ledger = Ledger { cast, ..Ledger::default() };
            }
            self.leave_all(kind, &mut flights, &mut traced);
        }
        let hits = self.next_hits(&flights, |images, flight| images.landing(&flight.ray));
        for (traced, (flight, hit)) in traced.iter_mut().zip(flights.into_iter().zip(hits)) {
            let Some(flight) = flight else { continue };
            traced.photon = self.land(&flight, hit.as_ref(), &mut traced.ledger);
        }
        traced
    }

    /// Photons that leave the closed objects that they are in.
    fn leave_all(&self, kind: Kind, flights: &mut [Option<Flight>; LANES], traced: &mut [Traced; LANES]) {
        let hits = self.next_hits(flights, |images, flight| images.exit(&flight.ray, flight.solid));
        for ((flight, hit), traced) in flights.iter_mut().zip(&hits).zip(traced) {
            if let Some(entered) = flight.take() {
                *flight = self.leave(kind, &entered, hit.as_ref(), &mut traced.ledger);
            }
        }
    }

    /// A photon that has left a closed object and enters another one; `None` if it meets something else.
    fn enter_another(&self, kind: Kind, left: &Flight, hit: &Hit) -> Option<Flight> {
        let refractor = self.surroundings.objects[hit.object as usize].refractor?;
        if refractor.interfaces == Interfaces::One || !hit.front {
            return None;
        }
        let (reflectance, refracted) = divided(&refractor, kind.eta(&refractor), (hit, &left.ray));
        Some(Flight {
            ray: Ray { origin: hit.position, direction: refracted?.direction },
            flux: left.flux * (1.0 - reflectance),
            way: Way { within: left.way.within + hit.distance, ..left.way },
            caster: left.caster,
            solid: hit.object,
        })
    }

    fn first_hits(&self, texels: &[[u32; 2]; LANES], rays: &[Ray; LANES], lanes: u32) -> [Option<Hit>; LANES] {
        let Some(images) = self.images else { return self.surroundings.tracer.secondary_hits(rays, lanes) };
        let size = DVec2::from_array(self.view.projection.size.map(f64::from));
        texels.map(|[x, y]| images.first.at((DVec2::new(f64::from(x), f64::from(y)) + self.pattern.offset) / size))
    }

    /// What photons meet next: by rays, or as `in_images` finds it.
    fn next_hits(
        &self,
        flights: &[Option<Flight>; LANES],
        in_images: impl Fn(&SurfaceImages, &Flight) -> Option<Hit>,
    ) -> [Option<Hit>; LANES] {
        if let Some(images) = self.images {
            return flights.each_ref().map(|flight| in_images(images, flight.as_ref()?));
        }
        let lanes = flights.iter().enumerate().filter(|(_, flight)| flight.is_some());
        let lanes = lanes.fold(0, |bits, (lane, _)| bits | 1 << lane);
        if lanes == 0 {
            return [None; LANES];
        }
        let idle = Ray { origin: Vec3::ZERO, direction: Vec3::Y };
        let rays = flights.each_ref().map(|flight| flight.as_ref().map_or(idle, |flight| flight.ray));
        self.surroundings.tracer.secondary_hits(&rays, lanes)
    }

    /// A photon that leaves the closed object that it has entered.
    fn leave(&self, kind: Kind, flight: &Flight, hit: Option<&Hit>, ledger: &mut Ledger) -> Option<Flight> {
        let lost = Ledger::sum(flight.flux);
        let Some(hit) = hit else {
            ledger[Loss::Missed] += lost;
            return None;
        };
        let object = &self.surroundings.objects[hit.object as usize];
        let Some(refractor) = object.refractor.filter(|r| r.interfaces == Interfaces::Two && !hit.front) else {
            ledger[Loss::NoReceiver] += lost;
            return None;
        };
        let (reflectance, refracted) = divided(&refractor, kind.eta(&refractor), (hit, &flight.ray));
        let Some(refracted) = refracted else {
            ledger[Loss::TotalReflection] += lost;
            return None;
        };
        ledger[Loss::TotalReflection] += lost * f64::from(reflectance);
        let last = SurfacePoint { position: hit.position, normal: hit.normal };
        Some(Flight {
            ray: Ray { origin: hit.position, direction: refracted.direction },
            flux: flight.flux * (1.0 - reflectance),
            way: Way { within: flight.way.within + hit.distance, last, ..flight.way },
            caster: flight.caster,
            solid: flight.solid,
        })
    }

    fn land(&self, flight: &Flight, hit: Option<&Hit>, ledger: &mut Ledger) -> Option<Photon> {
        let lost = match hit {
            None => Loss::Missed,
            Some(hit) if self.surroundings.objects[hit.object as usize].receiver.is_none() => Loss::NoReceiver,
            Some(hit) => {
                let undeflected = self.view.undeflected(hit.position);
                let cosine = |direction: Vec3| -direction.dot(hit.face_normal);
                let ratio = || cosine(flight.ray.direction) / cosine(undeflected).max(MIN_DIRECT_COSINE);
                return Some(Photon {
                    position: hit.position,
                    normal: hit.face_normal,
                    direction: flight.ray.direction,
                    undeflected,
                    flux: if self.pattern.is_papers { flight.flux * ratio() } else { flight.flux },
                    object: hit.object,
                    caster: flight.caster,
                    way: Way { beyond: hit.distance, ..flight.way },
                });
            }
        };
        ledger[lost] += Ledger::sum(flight.flux);
        None
    }
}

/// Whether a refractor lets light of a chain pass, as the first of its objects.
fn passes(refractor: &Refractor, chain: Chain) -> bool {
    match refractor.interfaces {
        Interfaces::One => chain == Chain::T,
        Interfaces::Two => matches!(chain, Chain::TT | Chain::TTTT),
    }
}

/// The mirrored direction; an interpolated normal may mirror it through the triangle at grazing angles.
fn reflected(direction: Vec3, hit: &Hit) -> Vec3 {
    let mirrored = direction - 2.0 * direction.dot(hit.normal) * hit.normal;
    let height = mirrored.dot(hit.face_normal);
    (mirrored + (MIN_HEIGHT - height).max(0.0) * hit.face_normal).normalize()
}
